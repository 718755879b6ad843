//! The linear system of a step of bundle adjustment.

use glam::{DMat3, DVec2, DVec3};

/// Steps of conjugate gradients, at most.
const MAX_SOLVER_STEPS: usize = 300;

/// Conjugate gradients end where the residual is this part of the first.
const TOLERANCE: f64 = 1e-8;

/// The residual of one observation, and its derivatives.
pub(crate) struct Row {
    /// The number of the point.
    pub(crate) point: usize,
    /// The image of the point minus its observation, in pixels.
    pub(crate) residual: DVec2,
    /// The weight of its square.
    pub(crate) weight: f64,
    /// By the coordinates of the point, in pixels per world unit.
    pub(crate) by_point: [DVec2; 3],
    /// By the free parameters of the camera, with their numbers.
    pub(crate) by_camera: Vec<(usize, DVec2)>,
}

impl Row {
    /// The motion of the image with the parameters.
    fn along(&self, parameters: &[f64]) -> DVec2 {
        self.by_camera.iter().map(|(number, slope)| *slope * parameters[*number]).sum()
    }

    /// The motion of the image with the point.
    fn along_point(&self, x: DVec3) -> DVec2 {
        let [a, b, c] = self.by_point;
        a * x.x + b * x.y + c * x.z
    }

    /// Adds the weighted transpose of the derivatives by the parameters, times `r`.
    fn add(&self, r: DVec2, sum: &mut [f64]) {
        let r = r * self.weight;
        self.by_camera.iter().for_each(|(number, slope)| sum[*number] += slope.dot(r));
    }

    /// The weighted transpose of the derivatives by the point, times `r`.
    fn of_point(&self, r: DVec2) -> DVec3 {
        DVec3::from(self.by_point.map(|slope| slope.dot(r * self.weight)))
    }
}

/// The normal equations of a step, as products with the rows.
pub(crate) struct System {
    rows: Vec<Row>,
    /// The curvature of the prior of each parameter.
    prior: Vec<f64>,
    /// The slope of the prior.
    pull: Vec<f64>,
    /// The curvature of each parameter, with the prior.
    curvature: Vec<f64>,
    /// The curvature of each point.
    of_points: Vec<DMat3>,
}

impl System {
    pub(crate) fn new(rows: Vec<Row>, points: usize, prior: Vec<f64>, pull: Vec<f64>) -> Self {
        let (mut curvature, mut of_points) = (prior.clone(), vec![DMat3::ZERO; points]);
        for row in &rows {
            for (number, slope) in &row.by_camera {
                curvature[*number] += row.weight * slope.length_squared();
            }
            of_points[row.point] += DMat3::from_cols_array_2d(
                &row.by_point.map(|slope| row.of_point(slope).to_array()),
            );
        }
        System { rows, prior, pull, curvature, of_points }
    }

    /// The step of the parameters and that of the points, with curvatures raised by the share
    /// `damping`.
    pub(crate) fn step(&self, damping: f64) -> (Vec<f64>, Vec<DVec3>) {
        let inverse: Vec<DMat3> = self.of_points.iter().map(|c| inverse(*c, damping)).collect();
        let mut pulls = vec![DVec3::ZERO; self.of_points.len()];
        for row in &self.rows {
            pulls[row.point] += row.of_point(row.residual);
        }
        let at_rest: Vec<DVec3> = inverse.iter().zip(&pulls).map(|(i, pull)| *i * *pull).collect();
        let mut right: Vec<f64> = self.pull.iter().map(|pull| -pull).collect();
        for row in &self.rows {
            row.add(row.along_point(at_rest[row.point]) - row.residual, &mut right);
        }
        let step = self.solved(&right, &inverse, damping);
        for row in &self.rows {
            pulls[row.point] += row.of_point(row.along(&step));
        }
        let of_points = inverse.iter().zip(&pulls).map(|(i, pull)| -(*i * *pull)).collect();
        (step, of_points)
    }

    /// The product of the curvature of the parameters, after the points are eliminated, with `v`.
    fn product(&self, v: &[f64], inverse: &[DMat3], damping: f64) -> Vec<f64> {
        let diagonal = self.prior.iter().zip(&self.curvature);
        let mut out: Vec<f64> =
            diagonal.zip(v).map(|((prior, c), v)| (prior + damping * c) * v).collect();
        let moves: Vec<DVec2> = self.rows.iter().map(|row| row.along(v)).collect();
        let mut of_points = vec![DVec3::ZERO; self.of_points.len()];
        for (row, u) in self.rows.iter().zip(&moves) {
            of_points[row.point] += row.of_point(*u);
        }
        of_points.iter_mut().zip(inverse).for_each(|(x, inverse)| *x = *inverse * *x);
        for (row, u) in self.rows.iter().zip(&moves) {
            row.add(*u - row.along_point(of_points[row.point]), &mut out);
        }
        out
    }

    /// The solution by conjugate gradients, preconditioned by the diagonal.
    fn solved(&self, right: &[f64], inverse: &[DMat3], damping: f64) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scaled = |r: &[f64]| -> Vec<f64> {
            r.iter().zip(&self.curvature).map(|(r, c)| r / (c * (1.0 + damping))).collect()
        };
        let (mut x, mut r) = (vec![0.0; right.len()], right.to_vec());
        let mut z = scaled(&r);
        let (mut along, mut size) = (z.clone(), dot(&r, &z));
        let first = size;
        for _ in 0..MAX_SOLVER_STEPS {
            if size <= first * TOLERANCE * TOLERANCE {
                break;
            }
            let product = self.product(&along, inverse, damping);
            let length = size / dot(&along, &product);
            x.iter_mut().zip(&along).for_each(|(x, p)| *x += length * p);
            r.iter_mut().zip(&product).for_each(|(r, p)| *r -= length * p);
            z = scaled(&r);
            let next = dot(&r, &z);
            along.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / size * *p);
            size = next;
        }
        x
    }
}

/// The inverse of a point's curvature, whose diagonal is raised by the share `damping`; zero for a
/// point that no row sees.
fn inverse(curvature: DMat3, damping: f64) -> DMat3 {
    let DMat3 { x_axis, y_axis, z_axis } = curvature;
    let raised = DVec3::new(x_axis.x, y_axis.y, z_axis.z) * damping;
    let all = curvature + DMat3::from_diagonal(raised);
    let inverse = all.inverse();
    if inverse.is_finite() { inverse } else { DMat3::ZERO }
}
