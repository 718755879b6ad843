//! The warp field of reparameterised silhouette gradients.
//!
//! A pixel's derivative has a part that comes from silhouettes moving across the film. The *warp field* V(u; θ), two
//! numbers in pixels per unit of θ, carries that part as an area integral: it is continuous in the film position u off
//! silhouettes, and at a silhouette it tends to the silhouette's velocity. This crate computes
//!
//! - V = −Σ_i a_i ∂_θ f(x_i), a_i = ŵ_i J(x_i) ∇f/|∇f|², over the points x_i that a sphere tracer visited along the ray;
//! - the weights ŵ_i ∝ S_i^−γ Δ_i, S = |f| + λ_d |∇f·d| + ε, of which the largest k are kept, less the smallest kept one;
//! - the exact divergence ∇_u·V, in which the points move with u;
//! - the reverse mode: coefficients α_i, c_i such that the parameter gradient is that of Σ α_i f(x_i) + c_i·∇f(x_i).
//!
//! Source: Bangaru, Gharbi, Li, Luan, Sunkavalli, Hašan, Bi, Xu, Bernstein and Durand, "Differentiable Rendering of Neural
//! SDFs through Reparameterization" (2022) and its supplement, sections 1, 3 and 4; the reverse mode is ours.
//!
//! ```
//! use field::{Field, Shape};
//! use glam::DVec3;
//! use warp::{Options, Projection, WarpedRay, evaluate};
//!
//! /// A film at distance 1 in front of an eye at (0, 0, 100) that looks down −z.
//! struct Film;
//! impl Projection<f64> for Film {
//!     fn jacobian(&self, x: DVec3) -> [DVec3; 2] {
//!         let depth = 100.0 - x.z;
//!         [DVec3::new(1.0, 0.0, x.x / depth) / depth, DVec3::new(0.0, 1.0, x.y / depth) / depth]
//!     }
//!     fn jacobian_derivative(&self, x: DVec3, dx: DVec3) -> [DVec3; 2] {
//!         let depth = 100.0 - x.z;
//!         let turn = |x: f64, x_dot: f64| x_dot / depth + 2.0 * x * dx.z / (depth * depth);
//!         let slow = dx.z / (depth * depth);
//!         [DVec3::new(slow, 0.0, turn(x.x, dx.x) / depth), DVec3::new(0.0, slow, turn(x.y, dx.y) / depth)]
//!     }
//! }
//!
//! // A ray that passes the unit ball at about x = 1.01, with the points a sphere tracer visits.
//! let ball = Shape::<f64>::sphere([0.0; 3], 1.0);
//! let origin = DVec3::new(0.0, 0.0, 100.0);
//! let direction = DVec3::new(0.0101, 0.0, -1.0).normalize();
//! let (mut t, mut f, mut g) = (vec![98.0], vec![], vec![]);
//! for i in 0..40 {
//!     let (mut value, mut gradient) = ([0.0], [DVec3::ZERO]);
//!     ball.value_gradient(&[origin + t[i] * direction], &mut value, &mut gradient);
//!     f.push(value[0]);
//!     g.push(gradient[0]);
//!     t.push(t[i] + value[0]);
//! }
//! let ray = WarpedRay {
//!     origin, direction, direction_du: [DVec3::X, -DVec3::Y],
//!     entry_du: [0.0; 2], exit_du: [0.0; 2], t: &t[..40], f: &f, gradient: &g, step: &f, clamped: false, valid: true,
//! };
//! let kept = evaluate(&ball, &Options::default(), &[&Film], &[ray], false);
//! // The radius' derivative: ∂f/∂radius = −1 everywhere; the silhouette's film velocity is (1, 0)/100.
//! let radius_dot: Vec<f64> = kept.points.iter().map(|_| -1.0).collect();
//! let v = kept.velocity(&radius_dot)[0];
//! assert!((v[0] - 0.01).abs() < 0.0005 && v[1].abs() < 1e-9);
//! ```
//!
//! # What is guaranteed
//! Weights are ratios of exponentials of log-weights, so that no γ overflows. Output is finite for finite input; a ray with
//! a NaN contributes nothing and is counted in [`Kept::invalid`]. Points whose weights tie exactly share their weight.
//!
//! # What is not
//! With N points the delta sits about 2r/N short of the silhouette: a bias that falls with N. At γ ≤ 2 there is no delta.

#![allow(clippy::needless_range_loop, reason = "points, weights and directions go in step: an index says so")]

mod evaluate;
mod options;
mod weights;

pub use evaluate::{Kept, Projection, WarpedRay, evaluate};
pub use options::{InvalidOptions, Options};
pub use weights::{Weights, weights};
