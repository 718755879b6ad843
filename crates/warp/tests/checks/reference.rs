//! An independent implementation of the warp, directly from its formulas: with powers, without
//! logarithms and without derivatives. It is slow, works for moderate γ only, and shares only the
//! field with the crate.

use glam::DVec3;
use warp::Projection;

use crate::scene::{Record, Scene};

/// The warp at one film position.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    pub(crate) record: Record,
    /// ŵ of every visited point.
    pub(crate) weight: Vec<f64>,
    /// a of every visited point.
    pub(crate) a: Vec<[f64; 2]>,
}

/// The branch of the piecewise smooth warp: the points that exist, those that keep a weight, and
/// all signs. It must not change within a difference stencil.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Branch {
    clamped: bool,
    kept: Vec<bool>,
    floor: Option<usize>,
    signs: Vec<[bool; 2]>,
}

/// The weights w of all points, without selection and normalisation.
fn quadrature(scene: &Scene, r: &Record) -> Vec<f64> {
    let o = &scene.options;
    (0..r.t.len())
        .map(|i| {
            let s = r.f[i].abs() + o.lambda_d * r.gradient[i].dot(r.direction).abs() + o.epsilon;
            s.powf(-o.gamma) * r.step[i]
        })
        .collect()
}

/// Indices from the largest weight to the smallest.
fn ranking(w: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..w.len()).collect();
    order.sort_by(|&a, &b| w[b].total_cmp(&w[a]));
    order
}

impl Reference {
    pub(crate) fn at(scene: &Scene, u: [f64; 2]) -> Option<Self> {
        let record = scene.record(u)?;
        let w = quadrature(scene, &record);
        let top: Vec<usize> = ranking(&w).into_iter().take(scene.options.top_k).collect();
        // A ray with fewer than k points counts as filled up with points of weight zero.
        let floor = if top.len() == scene.options.top_k { w[*top.last()?] } else { 0.0 };
        let mut shifted = vec![0.0; w.len()];
        top.iter().for_each(|&i| shifted[i] = w[i] - floor);
        let sum: f64 = shifted.iter().sum();
        let weight: Vec<f64> = shifted.iter().map(|w| w / sum).collect();
        let a = (0..w.len())
            .map(|i| {
                let g = record.gradient[i];
                Projection::<f64>::jacobian(&scene.camera, record.x(i))
                    .map(|row| weight[i] * row.dot(g / g.length_squared()))
            })
            .collect();
        Some(Reference { record, weight, a })
    }

    pub(crate) fn branch(&self, scene: &Scene) -> Branch {
        let r = &self.record;
        let w = quadrature(scene, r);
        let floor = ranking(&w).get(scene.options.top_k - 1).copied();
        Branch {
            clamped: r.clamped,
            kept: self.weight.iter().map(|w| *w > 0.0).collect(),
            floor,
            signs: (0..r.t.len())
                .map(|i| [r.f[i] > 0.0, r.gradient[i].dot(r.direction) > 0.0])
                .collect(),
        }
    }

    /// V for a direction in parameter space.
    pub(crate) fn velocity(&self, scene: &Scene, tangent: &[f64]) -> [f64; 2] {
        let n = self.a.len();
        let x: Vec<DVec3> = (0..n).map(|i| self.record.x(i)).collect();
        let (mut f_dot, mut g_dot) = (vec![0.0; n], vec![DVec3::ZERO; n]);
        scene.field.parameter_jvp(&x, tangent, &mut f_dot, &mut g_dot);
        [0, 1].map(|e| -self.a.iter().zip(&f_dot).map(|(a, f)| a[e] * f).sum::<f64>())
    }
}

/// Derivatives by u_x and u_y of many numbers: fourth-order central differences, step checked by
/// halving it. `None` where the branch changes within the stencil or the two steps disagree.
pub(crate) fn differences(
    scene: &Scene,
    u: [f64; 2],
    numbers: impl Fn(&Reference) -> Vec<f64>,
) -> Option<[Vec<f64>; 2]> {
    let centre = Reference::at(scene, u)?.branch(scene);
    let at = |e: usize, h: f64| {
        let mut u = u;
        u[e] += h;
        let there = Reference::at(scene, u)?;
        (there.branch(scene) == centre).then(|| numbers(&there))
    };
    let stencil = |e: usize, h: f64| {
        let (a, b, c, d) = (at(e, -2.0 * h)?, at(e, -h)?, at(e, h)?, at(e, 2.0 * h)?);
        let difference = |i: usize| (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (12.0 * h);
        Some((0..a.len()).map(difference).collect::<Vec<f64>>())
    };
    let checked = |e: usize| {
        let (coarse, fine) = (stencil(e, 4e-4)?, stencil(e, 2e-4)?);
        let agree = coarse.iter().zip(&fine).all(|(c, f)| (c - f).abs() < 3e-7 * (1.0 + f.abs()));
        agree.then_some(fine)
    };
    Some([checked(0)?, checked(1)?])
}
