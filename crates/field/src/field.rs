//! The field trait.

use std::ops::Range;

use crate::partial_sum::PartialSum;
use crate::real::{Real, Vector3};
use crate::sphere::Sphere;

/// A differentiable scalar field f(x; θ) over batches of points, read as a signed distance:
/// negative inside.
///
/// Points and values are in world units, gradients per world unit. The length of every slice of a
/// call is the number of points, except slices in parameter space: their length is
/// [`parameter_count`](Field::parameter_count). Other lengths are an error of the caller: an
/// implementation may panic or leave elements unset.
///
/// A NaN or an infinity in a point gives a value that is not finite, and never a panic.
///
/// A field that can fail (a device or a callback evaluates it) keeps its first error and writes
/// NaN from then on. Rendering and fitting then stop with an error that names a ray. The caller
/// asks the field for the cause before it uses any result.
pub trait Field<R: Real>: Send + Sync {
    /// The length of θ.
    fn parameter_count(&self) -> usize;

    /// A ball that contains the solid {f ≤ 0}, or `None` if the solid is unbounded.
    ///
    /// A field that is defined only in a ball (a network) returns that ball. Callers ignore the
    /// field outside it.
    fn bounds(&self) -> Option<Sphere<R>>;

    /// Whether |f(a) − f(b)| ≤ |a − b| is known for all points a and b, as for a distance.
    ///
    /// `false` by default: the slope of the field is then measured before rays are traced.
    fn is_lipschitz(&self) -> bool {
        false
    }

    /// Whether the surface {f = 0} can have creases: curves across which ∇f jumps.
    ///
    /// `false` by default, for fields that are smooth near their surface.
    fn has_creases(&self) -> bool {
        false
    }

    /// Writes, for points near the surface, the numbers of the faces that they are on.
    ///
    /// A face is a part of the surface near which f is smooth. Two points have the same number only
    /// if no crease separates their faces; different numbers need not mean a crease. By default
    /// there is one face.
    fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
        debug_assert_eq!(x.len(), face.len());
        face.fill(0);
    }

    /// Writes the values f(x).
    fn value(&self, x: &[R::Vec3], f: &mut [R]);

    /// Writes the values f(x) and the gradients ∇f(x).
    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]);

    /// Writes the gradients ∇f(x) and the Hessian–vector products ∇²f(x) p.
    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    );

    /// VJP of θ ↦ (f(x; θ), ∇f(x; θ)) to θ: adds Σ_i ∂_θ [α_i f(x_i; θ) + c_i·∇f(x_i; θ)] to
    /// `adjoint`.
    ///
    /// `alpha` holds the adjoints α_i of the values, `c` those of the gradients. The points do not
    /// move with θ.
    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]);

    /// The parameters of which each value depends on few, for example coefficients on a grid. By
    /// default none.
    fn table(&self) -> Range<usize> {
        0..0
    }

    /// As [`parameter_vjp`](Field::parameter_vjp), for a part of a batch. A field with a
    /// [`table`](Field::table) keeps the adjoints of its parameters as additions.
    fn add_parameter_vjp(
        &self,
        x: &[R::Vec3],
        alpha: &[R],
        c: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        debug_assert!(sum.place().is_empty(), "a table without additions");
        self.parameter_vjp(x, alpha, c, &mut sum.others);
    }

    /// JVP of θ ↦ (f(x; θ), ∇f(x; θ)): writes the changes of values and gradients as θ moves along
    /// `tangent`. The points do not move with θ.
    ///
    /// The provided method calls [`parameter_vjp`](Field::parameter_vjp) four times for each point,
    /// once for each row of the Jacobian. It is correct for every field, but slow for a field with
    /// many parameters.
    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        let (zero, one) = (R::zero(), R::one());
        let outputs = [
            (one, R::Vec3::zero()),
            (zero, R::Vec3::new(one, zero, zero)),
            (zero, R::Vec3::new(zero, one, zero)),
            (zero, R::Vec3::new(zero, zero, one)),
        ];
        let mut row = vec![zero; self.parameter_count()];
        for ((x, f), gradient) in x.iter().zip(f).zip(gradient) {
            let change = outputs.map(|(alpha, c)| {
                row.fill(zero);
                self.parameter_vjp(&[*x], &[alpha], &[c], &mut row);
                row.iter().zip(tangent).fold(zero, |sum, (&r, &t)| sum + r * t)
            });
            *f = change[0];
            *gradient = R::Vec3::new(change[1], change[2], change[3]);
        }
    }
}
