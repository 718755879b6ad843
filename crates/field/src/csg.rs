//! Constructive solid geometry over any fields.

use crate::{Dual, Field, Real, Scalar, Sphere, Vector3};

/// How children become one solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// The smallest child.
    Union,
    /// The largest child.
    Intersection,
    /// The first child without all the others.
    Subtraction,
    /// Children blended pairwise from the left by the quadratic polynomial minimum of width k:
    /// min(a, b) − k h²/4 with h = max(0, 1 − |a − b|/k).
    SmoothUnion,
}

/// A combination F = g(f_1, …, f_n) of child fields.
///
/// F is exact on the side where the solid's distance is that of one child, and a lower bound
/// elsewhere (the inside of a union, the outside of an intersection), so sphere tracing stays safe.
/// Where two children tie, the derivative is that of the earlier child. Parameters are the
/// children's, one after the other; a smooth union's k comes last.
pub struct Csg<R> {
    operation: Operation,
    blend: R,
    children: Vec<Box<dyn Field<R>>>,
}

impl<R: Real + Scalar<Real = R>> Csg<R> {
    /// A union, an intersection or a subtraction.
    ///
    /// # Panics
    /// If there are no children, or the operation is a smooth union (see [`Csg::smooth_union`]).
    pub fn new(operation: Operation, children: Vec<Box<dyn Field<R>>>) -> Self {
        assert!(operation != Operation::SmoothUnion, "a smooth union needs its width");
        assert!(!children.is_empty(), "a combination needs a child");
        Csg { operation, blend: R::zero(), children }
    }

    /// A smooth union of width `k` > 0, in world units.
    ///
    /// # Panics
    /// If there are no children or `k` is not positive.
    pub fn smooth_union(k: f64, children: Vec<Box<dyn Field<R>>>) -> Self {
        assert!(k > 0.0, "the width of a smooth union is positive, not {k}");
        assert!(!children.is_empty(), "a combination needs a child");
        Csg { operation: Operation::SmoothUnion, blend: R::of(k), children }
    }

    /// g, in any arithmetic.
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

    /// ∂g/∂f_i for every child and ∂g/∂k, at child values `f` whose tangent is `dot` (and their
    /// tangents, in `.d[0]`).
    fn slopes(&self, f: &[R], dot: &[R], slope: &mut [Dual<R, 1>]) {
        let zero = Dual::<R, 1>::constant(R::zero());
        let one = Dual::<R, 1>::constant(R::one());
        let seed = |on: bool| [if on { one } else { zero }];
        let n = self.children.len();
        for (j, slope) in slope.iter_mut().enumerate() {
            let values =
                (0..n).map(|i| Dual { value: Dual { value: f[i], d: [dot[i]] }, d: seed(i == j) });
            let k = Dual { value: Dual::lift(self.blend), d: seed(j == n) };
            *slope = self.combine(k, values).d[0];
        }
    }

    fn offsets(&self) -> impl Iterator<Item = (usize, &dyn Field<R>)> {
        self.children.iter().scan(0, |start, child| {
            let at = *start;
            *start += child.parameter_count();
            Some((at, child.as_ref()))
        })
    }

    /// Values and gradients of all children, child after child.
    fn evaluate(&self, x: &[R::Vec3]) -> (Vec<R>, Vec<R::Vec3>) {
        let n = x.len();
        let mut f = vec![R::zero(); n * self.children.len()];
        let mut g = vec![R::Vec3::zero(); f.len()];
        for (i, child) in self.children.iter().enumerate() {
            let span = i * n..(i + 1) * n;
            child.value_gradient(x, &mut f[span.clone()], &mut g[span]);
        }
        (f, g)
    }

    /// Visits every point with the children's values, their slopes in g, and the slopes' change as
    /// the point moves along `direction`.
    fn for_each_point(
        &self,
        x: &[R::Vec3],
        direction: impl Fn(usize) -> R::Vec3,
        mut visit: impl FnMut(usize, &[Dual<R, 1>], &[R::Vec3]),
    ) {
        let (f, g) = self.evaluate(x);
        let (n, children) = (x.len(), self.children.len());
        let (mut fs, mut dots) = (vec![R::zero(); children], vec![R::zero(); children]);
        let mut gs = vec![R::Vec3::zero(); children];
        let mut slope = vec![Dual::constant(R::zero()); children + 1];
        for p in 0..n {
            for i in 0..children {
                fs[i] = f[i * n + p];
                gs[i] = g[i * n + p];
                dots[i] = gs[i].dot(direction(p));
            }
            self.slopes(&fs, &dots, &mut slope);
            visit(p, &slope, &gs);
        }
    }
}

impl<R: Real + Scalar<Real = R>> Field<R> for Csg<R> {
    fn parameter_count(&self) -> usize {
        let own = usize::from(self.operation == Operation::SmoothUnion);
        self.children.iter().map(|c| c.parameter_count()).sum::<usize>() + own
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let mut bounds = self.children.iter().map(|c| c.bounds());
        match self.operation {
            Operation::Subtraction => bounds.next().flatten(),
            // Of the children's balls any one will do; the smallest is the tightest.
            Operation::Intersection => {
                bounds.flatten().reduce(|a, b| if b.radius < a.radius { b } else { a })
            }
            Operation::Union | Operation::SmoothUnion => {
                let all: Option<Vec<_>> = bounds.collect();
                let union = all?.into_iter().reduce(|a, b| a.union(&b))?;
                // Each pairwise blend pulls the surface out by at most k/4.
                let swell = self.blend * R::of(0.25) * R::of((self.children.len() - 1) as f64);
                Some(Sphere { center: union.center, radius: union.radius + swell })
            }
        }
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        let n = x.len();
        let mut all = vec![R::zero(); n * self.children.len()];
        for (child, f) in self.children.iter().zip(all.chunks_mut(n.max(1))) {
            child.value(x, f);
        }
        for (p, f) in f.iter_mut().enumerate() {
            *f = self.combine(self.blend, (0..self.children.len()).map(|i| all[i * n + p]));
        }
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        self.value(x, f);
        self.for_each_point(x, |_| R::Vec3::zero(), |p, slope, g| gradient[p] = weighted(slope, g));
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
                gradient[q] = weighted(slope, g);
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
        let mut blend = R::zero();
        self.for_each_point(
            x,
            |p| c[p],
            |p, slope, _| {
                for i in 0..children {
                    child_alpha[i * n + p] = alpha[p] * slope[i].value + slope[i].d[0];
                    child_c[i * n + p] = c[p] * slope[i].value;
                }
                blend += alpha[p] * slope[children].value + slope[children].d[0];
            },
        );
        for (i, (start, child)) in self.offsets().enumerate() {
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
            *last += blend;
        }
    }
}

/// Σ_i slope_i g_i.
fn weighted<R: Real + Scalar<Real = R>>(slope: &[Dual<R, 1>], g: &[R::Vec3]) -> R::Vec3 {
    g.iter().zip(slope).fold(R::Vec3::zero(), |sum, (g, s)| sum + *g * s.value)
}
