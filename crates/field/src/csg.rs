//! Constructive solid geometry (CSG) over any fields.
//!
//! Minimum and maximum as union and intersection: A. Ricci, “A constructive geometry for computer
//! graphics”, The Computer Journal 16(2), 1973. Smooth union: the quadratic polynomial minimum of
//! Inigo Quilez, “Smooth minimum”, 2013.

use std::fmt;

use crate::dual::{Dual, Scalar};
use crate::field::Field;
use crate::real::{Real, Vector3};
use crate::sphere::Sphere;

/// The operation that combines children f_1, …, f_n into one solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// min(f_1, …, f_n).
    Union,
    /// max(f_1, …, f_n).
    Intersection,
    /// max(f_1, −f_2, …, −f_n): the first solid without all the others.
    Subtraction,
    /// A union with rounded joints of width k, in world units. Two children a and b become
    /// min(a, b) − k h²/4 with h = max(0, 1 − |a − b|/k); more children are blended in pairs from
    /// the left, so their order matters.
    SmoothUnion,
}

/// A combination F = g(f_1, …, f_n) of child fields.
///
/// Parameters are those of the children, one child after the other. A smooth union has one more,
/// its width k, at the end.
///
/// If the children are exact signed distances, then |F| is at most the distance to the surface
/// {F = 0}: sphere tracing with steps F does not cross it. F is the exact distance outside a union,
/// inside an intersection and inside a subtraction. Elsewhere, and for a smooth union, |F| can be
/// smaller than the distance.
///
/// Derivatives do not exist where two children are equal. There the derivative is that of the
/// earlier child.
pub struct Csg<R> {
    operation: Operation,
    blend: R,
    children: Vec<Box<dyn Field<R>>>,
}

impl<R: Real> fmt::Debug for Csg<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Csg");
        shown.field("operation", &self.operation).field("blend", &self.blend);
        shown.field("children", &self.children.len()).finish()
    }
}

impl<R: Real + Scalar<Real = R>> Csg<R> {
    /// A union, an intersection or a subtraction.
    ///
    /// # Panics
    /// If there are no children, or the operation is a smooth union (see [`Csg::smooth_union`]).
    pub fn new(operation: Operation, children: Vec<Box<dyn Field<R>>>) -> Self {
        assert!(
            operation != Operation::SmoothUnion,
            "use `Csg::smooth_union`, which takes the width k"
        );
        assert!(!children.is_empty(), "a CSG operation needs at least one child");
        Csg { operation, blend: R::zero(), children }
    }

    /// A smooth union of width `k` > 0, in world units.
    ///
    /// # Panics
    /// If there are no children or `k` is not positive.
    pub fn smooth_union(k: f64, children: Vec<Box<dyn Field<R>>>) -> Self {
        assert!(k > 0.0, "the width k of a smooth union must be above 0, not {k}");
        assert!(!children.is_empty(), "a CSG operation needs at least one child");
        Csg { operation: Operation::SmoothUnion, blend: R::of(k), children }
    }

    /// g for children in the number type `S`, with the smooth union's width `k`.
    fn combine<S: Scalar<Real = R>>(&self, k: S, children: impl Iterator<Item = S>) -> S {
        let half = S::constant(R::of(0.5));
        let zero = S::constant(R::zero());
        children
            .enumerate()
            .map(|(i, f)| if self.operation == Operation::Subtraction && i > 0 { -f } else { f })
            .reduce(|a, b| match self.operation {
                Operation::Union => a.min(b),
                Operation::Intersection | Operation::Subtraction => a.max(b),
                Operation::SmoothUnion => {
                    let h = (k - (a - b).abs()).max(zero) * half;
                    a.min(b) - h * h / k
                }
            })
            .unwrap_or(zero)
    }

    /// The slopes ∂g/∂f_i of all children, then ∂g/∂k, at the children's values `f`.
    ///
    /// `.d[0]` of a slope is its tangent as the children's values move along `f_tangent`.
    fn slopes(&self, f: &[R], f_tangent: &[R], slope: &mut [Dual<R, 1>]) {
        let zero = Dual::<R, 1>::constant(R::zero());
        let one = Dual::<R, 1>::constant(R::one());
        let seed = |on: bool| [if on { one } else { zero }];
        let n = self.children.len();
        for (j, slope) in slope.iter_mut().enumerate() {
            let values = (0..n)
                .map(|i| Dual { value: Dual { value: f[i], d: [f_tangent[i]] }, d: seed(i == j) });
            let k = Dual { value: Dual::lift(self.blend), d: seed(j == n) };
            *slope = self.combine(k, values).d[0];
        }
    }

    /// Every child with the index of its first parameter.
    fn children_with_offsets(&self) -> impl Iterator<Item = (usize, &dyn Field<R>)> {
        self.children.iter().scan(0, |start, child| {
            let offset = *start;
            *start += child.parameter_count();
            Some((offset, child.as_ref()))
        })
    }

    /// Values of all children: that of child i at point p has the index i n + p, with n the number
    /// of points.
    fn child_values(&self, x: &[R::Vec3]) -> Vec<R> {
        let mut f = vec![R::zero(); x.len() * self.children.len()];
        for (child, f) in self.children.iter().zip(f.chunks_mut(x.len().max(1))) {
            child.value(x, f);
        }
        f
    }

    /// The value and the face of g for two children, from their values and faces.
    fn joined(&self, a: (R, u32), b: (R, u32)) -> (R, u32) {
        match self.operation {
            Operation::Union if a.0 <= b.0 => a,
            Operation::Intersection | Operation::Subtraction if a.0 >= b.0 => a,
            Operation::SmoothUnion => {
                let value = self.combine(self.blend, [a.0, b.0].into_iter());
                let joint = Scalar::abs(a.0 - b.0) < self.blend;
                let face = if joint { mixed(a.1, b.1) } else { (if a.0 <= b.0 { a } else { b }).1 };
                (value, face)
            }
            _ => b,
        }
    }

    /// Values and gradients of all children: those of child i at point p have index i n + p, with n
    /// the number of points.
    fn evaluate_children(&self, x: &[R::Vec3]) -> (Vec<R>, Vec<R::Vec3>) {
        let n = x.len();
        let mut f = vec![R::zero(); n * self.children.len()];
        let mut g = vec![R::Vec3::zero(); f.len()];
        for (i, child) in self.children.iter().enumerate() {
            let span = i * n..(i + 1) * n;
            child.value_gradient(x, &mut f[span.clone()], &mut g[span]);
        }
        (f, g)
    }

    /// Calls `visit` for every point: with its index, the [`slopes`](Self::slopes) there and the
    /// children's gradients.
    ///
    /// The slopes' tangents are for a motion of the point along `direction`.
    fn for_each_point(
        &self,
        x: &[R::Vec3],
        direction: impl Fn(usize) -> R::Vec3,
        mut visit: impl FnMut(usize, &[Dual<R, 1>], &[R::Vec3]),
    ) {
        let (f, g) = self.evaluate_children(x);
        let (n, children) = (x.len(), self.children.len());
        let (mut f_here, mut f_tangent) = (vec![R::zero(); children], vec![R::zero(); children]);
        let mut g_here = vec![R::Vec3::zero(); children];
        let mut slope = vec![Dual::constant(R::zero()); children + 1];
        for p in 0..n {
            for i in 0..children {
                f_here[i] = f[i * n + p];
                g_here[i] = g[i * n + p];
                f_tangent[i] = g_here[i].dot(direction(p));
            }
            self.slopes(&f_here, &f_tangent, &mut slope);
            visit(p, &slope, &g_here);
        }
    }
}

impl<R: Real + Scalar<Real = R>> Field<R> for Csg<R> {
    fn parameter_count(&self) -> usize {
        let blend_parameters = usize::from(self.operation == Operation::SmoothUnion);
        self.children.iter().map(|c| c.parameter_count()).sum::<usize>() + blend_parameters
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let mut bounds = self.children.iter().map(|c| c.bounds());
        match self.operation {
            Operation::Subtraction => bounds.next().flatten(),
            // Each child's ball contains the intersection: take the smallest.
            Operation::Intersection => {
                bounds.flatten().reduce(|a, b| if b.radius < a.radius { b } else { a })
            }
            Operation::Union | Operation::SmoothUnion => {
                let all: Option<Vec<_>> = bounds.collect();
                let union = all?.into_iter().reduce(|a, b| a.union(&b))?;
                // Each blend of two children lowers F by at most k/4, which moves the surface of
                // exact distances out by at most k/4.
                let blend_margin =
                    self.blend * R::of(0.25) * R::of((self.children.len() - 1) as f64);
                Some(Sphere { center: union.center, radius: union.radius + blend_margin })
            }
        }
    }

    fn is_lipschitz(&self) -> bool {
        self.children.iter().all(|child| child.is_lipschitz())
    }

    fn has_creases(&self) -> bool {
        (self.operation != Operation::SmoothUnion && self.children.len() > 1)
            || self.children.iter().any(|child| child.has_creases())
    }

    /// The face of the child that g takes its value from. In the joint of a smooth union, both
    /// children's faces count.
    fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
        let n = x.len();
        let f = self.child_values(x);
        let mut own = vec![0; f.len()];
        for (child, own) in self.children.iter().zip(own.chunks_mut(n.max(1))) {
            child.faces(x, own);
        }
        for (p, face) in face.iter_mut().enumerate() {
            let child = |i: usize| {
                let f = f[i * n + p];
                let negated = self.operation == Operation::Subtraction && i > 0;
                (if negated { -f } else { f }, mixed(i as u32, own[i * n + p]))
            };
            let last = (0..self.children.len()).map(child).reduce(|a, b| self.joined(a, b));
            *face = last.map_or(0, |(_, face)| face);
        }
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        let (n, all) = (x.len(), self.child_values(x));
        for (p, f) in f.iter_mut().enumerate() {
            *f = self.combine(self.blend, (0..self.children.len()).map(|i| all[i * n + p]));
        }
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        self.value(x, f);
        self.for_each_point(
            x,
            |_| R::Vec3::zero(),
            |p, slope, g| gradient[p] = weighted_sum(slope, g),
        );
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        let n = x.len();
        let mut child_gradient = vec![R::Vec3::zero(); n];
        let mut child_product = vec![R::Vec3::zero(); n * self.children.len()];
        for (child, product) in self.children.iter().zip(child_product.chunks_mut(n.max(1))) {
            child.hessian_vector(x, p, &mut child_gradient, product);
        }
        self.for_each_point(
            x,
            |q| p[q],
            |q, slope, g| {
                gradient[q] = weighted_sum(slope, g);
                product[q] = g.iter().enumerate().fold(R::Vec3::zero(), |sum, (i, g)| {
                    sum + child_product[i * n + q] * slope[i].value + *g * slope[i].d[0]
                });
            },
        );
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        let (n, children) = (x.len(), self.children.len());
        let mut child_alpha = vec![R::zero(); n * children];
        let mut child_c = vec![R::Vec3::zero(); n * children];
        let mut blend_adjoint = R::zero();
        self.for_each_point(
            x,
            |p| c[p],
            |p, slope, _| {
                for i in 0..children {
                    child_alpha[i * n + p] = alpha[p] * slope[i].value + slope[i].d[0];
                    child_c[i * n + p] = c[p] * slope[i].value;
                }
                blend_adjoint += alpha[p] * slope[children].value + slope[children].d[0];
            },
        );
        for (i, (start, child)) in self.children_with_offsets().enumerate() {
            let (span, end) = (i * n..(i + 1) * n, start + child.parameter_count());
            child.parameter_vjp(
                x,
                &child_alpha[span.clone()],
                &child_c[span],
                &mut adjoint[start..end],
            );
        }
        if self.operation == Operation::SmoothUnion
            && let Some(last) = adjoint.last_mut()
        {
            *last += blend_adjoint;
        }
    }
}

/// A number for two numbers: different pairs have different ones, but for rare chances.
pub(crate) fn mixed(a: u32, b: u32) -> u32 {
    let bits = (u64::from(a) << 32 | u64::from(b)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ bits >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (bits ^ bits >> 32) as u32
}

/// The gradient of F: Σ_i slope_i ∇f_i.
fn weighted_sum<R: Real + Scalar<Real = R>>(slope: &[Dual<R, 1>], g: &[R::Vec3]) -> R::Vec3 {
    g.iter().zip(slope).fold(R::Vec3::zero(), |sum, (g, s)| sum + *g * s.value)
}
