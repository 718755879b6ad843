//! Scenes for the checks: a pinhole, fields, and the recursion of plain sphere tracing, which fills
//! the record of a ray.

use field::{Csg, Field, Kind, Shape, Sphere};
use glam::DVec3;
use warp::{
    Projection, PublishedWeighting, Warp, WarpOptions, WarpWithDivergence, WarpedRay, evaluate,
    evaluate_with_divergence,
};

/// A pinhole with focal length and principal point in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pinhole {
    pub(crate) eye: DVec3,
    pub(crate) right: DVec3,
    pub(crate) down: DVec3,
    pub(crate) forward: DVec3,
    pub(crate) focal: f64,
    pub(crate) principal: [f64; 2],
}

impl Pinhole {
    pub(crate) fn looking_at_origin(eye: DVec3) -> Self {
        let forward = -eye.normalize();
        let right = forward.cross(DVec3::Y).normalize();
        Pinhole {
            eye,
            right,
            down: forward.cross(right),
            forward,
            focal: 64.0,
            principal: [16.0, 16.0],
        }
    }

    /// The unnormalised direction through u; affine in u.
    fn through(&self, u: [f64; 2]) -> DVec3 {
        let [x, y] = [0, 1].map(|e| (u[e] - self.principal[e]) / self.focal);
        self.forward + self.right * x + self.down * y
    }

    pub(crate) fn direction(&self, u: [f64; 2]) -> DVec3 {
        self.through(u).normalize()
    }

    pub(crate) fn direction_du(&self, u: [f64; 2]) -> [DVec3; 2] {
        let (w, d) = (self.through(u), self.direction(u));
        [self.right, self.down].map(|axis| (axis - d * d.dot(axis)) / (self.focal * w.length()))
    }

    pub(crate) fn project(&self, x: DVec3) -> [f64; 2] {
        let r = x - self.eye;
        let scale = self.focal / r.dot(self.forward);
        [
            self.principal[0] + scale * r.dot(self.right),
            self.principal[1] + scale * r.dot(self.down),
        ]
    }
}

impl Projection<f64> for Pinhole {
    fn jacobian(&self, x: DVec3) -> [DVec3; 2] {
        let r = x - self.eye;
        let depth = r.dot(self.forward);
        [self.right, self.down].map(|axis| {
            (axis * depth - self.forward * r.dot(axis)) * (self.focal / (depth * depth))
        })
    }

    fn jacobian_derivative(&self, x: DVec3, dx: DVec3) -> [DVec3; 2] {
        let r = x - self.eye;
        let (depth, depth_dot) = (r.dot(self.forward), dx.dot(self.forward));
        [self.right, self.down].map(|axis| {
            let numerator = axis * depth - self.forward * r.dot(axis);
            let numerator_dot = axis * depth_dot - self.forward * dx.dot(axis);
            (numerator_dot * depth - numerator * (2.0 * depth_dot)) * (self.focal / depth.powi(3))
        })
    }
}

/// A field times a number: like the field of a network, it is not a distance.
pub(crate) struct Scaled(Box<dyn Field<f64>>, f64);

impl Field<f64> for Scaled {
    fn parameter_count(&self) -> usize {
        self.0.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        self.0.bounds()
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        self.0.value(x, f);
        f.iter_mut().for_each(|f| *f *= self.1);
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        self.0.value_gradient(x, f, gradient);
        f.iter_mut().for_each(|f| *f *= self.1);
        gradient.iter_mut().for_each(|g| *g *= self.1);
    }
    fn hessian_vector(
        &self,
        x: &[DVec3],
        p: &[DVec3],
        gradient: &mut [DVec3],
        product: &mut [DVec3],
    ) {
        self.0.hessian_vector(x, p, gradient, product);
        gradient.iter_mut().chain(product).for_each(|g| *g *= self.1);
    }
    fn parameter_vjp(&self, x: &[DVec3], alpha: &[f64], c: &[DVec3], adjoint: &mut [f64]) {
        let alpha: Vec<f64> = alpha.iter().map(|a| a * self.1).collect();
        let c: Vec<DVec3> = c.iter().map(|c| *c * self.1).collect();
        self.0.parameter_vjp(x, &alpha, &c, adjoint);
    }
    fn parameter_jvp(&self, x: &[DVec3], tangent: &[f64], f: &mut [f64], gradient: &mut [DVec3]) {
        self.0.parameter_jvp(x, tangent, f, gradient);
        f.iter_mut().for_each(|f| *f *= self.1);
        gradient.iter_mut().for_each(|g| *g *= self.1);
    }
}

/// Sphere, torus, smooth union, and each of them stretched.
pub(crate) fn field(kind: usize) -> Box<dyn Field<f64>> {
    let sphere = |c, r| Box::new(Shape::sphere(c, r)) as Box<dyn Field<f64>>;
    let torus = || Box::new(Shape::new(Kind::Torus, &[0.05, 0.1, 0.0, 0.3, 0.8, 0.5, 0.55, 0.2]));
    let plain = match kind % 3 {
        0 => sphere([0.05, 0.03, 0.0], 0.7),
        1 => torus(),
        _ => Box::new(Csg::smooth_union(0.3, vec![sphere([0.35, 0.0, 0.2], 0.4), torus()])),
    };
    match kind / 3 {
        0 => plain,
        // Steps of 1.3 f overshoot: f changes sign.
        1 => Box::new(Scaled(plain, 1.3)),
        _ => Box::new(Scaled(plain, 0.7)),
    }
}

pub(crate) const FIELDS: usize = 9;

pub(crate) struct Scene {
    pub(crate) field: Box<dyn Field<f64>>,
    pub(crate) camera: Pinhole,
    pub(crate) bounds: Sphere<f64>,
    /// Lengths are in world units: the radius of 1 is implied.
    pub(crate) options: WarpOptions,
    /// ρ.
    pub(crate) relaxation: f64,
}

impl Scene {
    pub(crate) fn new(field: Box<dyn Field<f64>>, options: WarpOptions) -> Self {
        let camera = Pinhole::looking_at_origin(DVec3::new(0.6, 0.8, 3.6));
        Scene {
            field,
            camera,
            bounds: Sphere { center: DVec3::new(0.0, 0.05, 0.0), radius: 1.4 },
            options,
            relaxation: 1.0,
        }
    }

    pub(crate) fn weighting(&self) -> PublishedWeighting<f64> {
        self.options.weighting(1.0)
    }

    pub(crate) fn warp(&self, rays: &[WarpedRay<'_, f64>]) -> Warp<f64> {
        evaluate(&self.weighting(), self.options.top_k, &[&self.camera], rays)
    }

    pub(crate) fn warp_with_divergence(
        &self,
        rays: &[WarpedRay<'_, f64>],
    ) -> WarpWithDivergence<f64> {
        self.warp_of_field(self.field.as_ref(), rays)
    }

    pub(crate) fn warp_of_field(
        &self,
        field: &(impl Field<f64> + ?Sized),
        rays: &[WarpedRay<'_, f64>],
    ) -> WarpWithDivergence<f64> {
        let (k, charts) = (self.options.top_k, [&self.camera]);
        evaluate_with_divergence(field, &self.weighting(), k, &charts, rays)
    }

    /// The recursion t ← t + ρ f, from the entry of the ray into the bounds to its exit. `None` if
    /// the ray misses the bounds.
    pub(crate) fn record(&self, u: [f64; 2]) -> Option<Record> {
        let (origin, direction) = (self.camera.eye, self.camera.direction(u));
        let (near, far) = self.bounds.clip(origin, direction)?;
        let mut r = Record {
            origin,
            direction,
            du: self.camera.direction_du(u),
            relaxation: self.relaxation,
            ..Record::default()
        };
        let mut t = near;
        for _ in 0..self.options.steps {
            let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
            self.field.value_gradient(&[origin + t * direction], &mut f, &mut g);
            let step = self.relaxation * f[0];
            r.clamped = step >= far - t;
            r.t.push(t);
            r.f.push(f[0]);
            r.gradient.push(g[0]);
            r.step.push(step.abs().min(far - t));
            t += step;
            if r.clamped {
                break;
            }
        }
        // The ends of the interval stay on the sphere: (x − c)·∂x = 0.
        let end = |t: f64| {
            let radial = origin + t * direction - self.bounds.center;
            r.du.map(|du| -t * radial.dot(du) / radial.dot(direction))
        };
        (r.entry_du, r.exit_du) = (end(near), end(far));
        Some(r)
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Record {
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    pub(crate) du: [DVec3; 2],
    pub(crate) entry_du: [f64; 2],
    pub(crate) exit_du: [f64; 2],
    pub(crate) relaxation: f64,
    pub(crate) t: Vec<f64>,
    pub(crate) f: Vec<f64>,
    pub(crate) gradient: Vec<DVec3>,
    pub(crate) step: Vec<f64>,
    pub(crate) clamped: bool,
}

impl Record {
    pub(crate) fn ray(&self) -> WarpedRay<'_, f64> {
        WarpedRay {
            origin: self.origin,
            direction: self.direction,
            direction_du: self.du,
            entry_du: self.entry_du,
            exit_du: self.exit_du,
            relaxation: self.relaxation,
            t: &self.t,
            f: &self.f,
            gradient: &self.gradient,
            step: &self.step,
            clamped: self.clamped,
            valid: true,
        }
    }

    pub(crate) fn x(&self, i: usize) -> DVec3 {
        self.origin + self.t[i] * self.direction
    }
}
