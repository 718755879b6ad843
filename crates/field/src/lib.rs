//! Scalar fields over batches of points: the bottom layer of dsdf.
//!
//! A *field* is a function f(x; θ) of a point x in space and a flat vector of parameters θ. dsdf
//! reads it as a signed distance: negative inside the solid, positive outside, in world units.
//! Everything above this crate (sphere tracing, warp fields, fitting) knows a field by the
//! [`Field`] trait alone: its value, its spatial gradient, Hessian–vector products, and the
//! parameter gradient of α f(x) + c·∇f(x), all over batches.
//!
//! The crate also holds the analytic shapes ([`Shape`]) and their constructive combinations
//! ([`Csg`]), which have closed-form answers and so serve as scenes and as ground truth.
//!
//! ```
//! use field::{Csg, Field, Operation, Shape, Vector3};
//! use glam::DVec3;
//!
//! // A unit ball with a smaller ball carved out of its right side.
//! let ball = Shape::<f64>::sphere([0.0; 3], 1.0);
//! let bite = Shape::<f64>::sphere([1.0, 0.0, 0.0], 0.5);
//! let solid = Csg::new(Operation::Subtraction, vec![Box::new(ball), Box::new(bite)]);
//!
//! let points = [DVec3::new(-0.5, 0.0, 0.0), DVec3::new(0.75, 0.0, 0.0)];
//! let (mut f, mut gradient) = ([0.0; 2], [DVec3::ZERO; 2]);
//! solid.value_gradient(&points, &mut f, &mut gradient);
//! assert_eq!(f, [-0.5, 0.25]); // half a unit inside; in the bite, a quarter outside
//! assert_eq!(gradient[1], DVec3::X); // the way into the solid's outside, towards the bite's centre
//! ```
//!
//! # Conventions
//! Points are in world units; gradients are per world unit. A batch is a slice with one element a
//! point, and all slices of one call have one length. Fields do not parallelise: the caller splits
//! batches over threads, in chunks whose size does not depend on the number of threads, so that
//! sums come out with the same bits.

mod counted;
mod csg;
mod dual;
mod real;
mod shape;
mod sphere;
mod surface;

pub use counted::{Counted, Evaluations};
pub use csg::{Csg, Operation};
pub use dual::{Dual, Scalar};
pub use real::{Real, Vector3};
pub use shape::{Kind, Shape};
pub use sphere::Sphere;
pub use surface::{SurfaceAdjoint, SurfaceBatch};

/// A differentiable scalar field f(x; θ) over batches of points.
///
/// Every slice of a call has the length of `x`, except those in parameter space, which have
/// [`parameter_count`](Field::parameter_count). Implementations panic on other lengths. A NaN or an
/// infinity in a point comes out as a NaN, never as a panic.
pub trait Field<R: Real>: Send + Sync {
    /// The length of θ.
    fn parameter_count(&self) -> usize;

    /// A sphere that holds the solid {f ≤ 0}, or `None` where the solid is unbounded.
    ///
    /// For a field that is defined in a ball only (a network), that ball: nothing outside is seen.
    fn bounds(&self) -> Option<Sphere<R>>;

    /// f(x).
    fn value(&self, x: &[R::Vec3], f: &mut [R]);

    /// f(x) and ∇f(x).
    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]);

    /// ∇f(x) and the Hessian–vector product ∇²f(x) p.
    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    );

    /// VJP of θ ↦ (f, ∇f): adds Σ_i ∂_θ [α_i f(x_i) + c_i·∇f(x_i)] to `adjoint`, points and
    /// coefficients held fixed.
    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]);

    /// JVP of θ ↦ (f, ∇f): the change of value and gradient at fixed points as θ moves along
    /// `tangent`.
    ///
    /// The provided method transposes [`parameter_vjp`](Field::parameter_vjp) point by point, four
    /// calls each: right for any field, slow for one with many parameters.
    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        let (zero, one) = (R::zero(), R::one());
        let axes = [
            (one, R::Vec3::zero()),
            (zero, R::Vec3::new(one, zero, zero)),
            (zero, R::Vec3::new(zero, one, zero)),
            (zero, R::Vec3::new(zero, zero, one)),
        ];
        let mut row = vec![zero; self.parameter_count()];
        for ((x, f), gradient) in x.iter().zip(f).zip(gradient) {
            let along = axes.map(|(alpha, c)| {
                row.fill(zero);
                self.parameter_vjp(&[*x], &[alpha], &[c], &mut row);
                row.iter().zip(tangent).fold(zero, |sum, (&r, &t)| sum + r * t)
            });
            *f = along[0];
            *gradient = R::Vec3::new(along[1], along[2], along[3]);
        }
    }
}
