//! A field clipped to a ball.

use std::ops::Range;

use crate::csg::mixed;
use crate::fibonacci::fibonacci_direction;
use crate::field::Field;
use crate::partial_sum::PartialSum;
use crate::real::{Real, Vector3};
use crate::sphere::Sphere;

/// The solid of a field inside a ball: F(x) = max(f(x), |x − c| − r).
///
/// The part of the ball's surface inside {f ≤ 0} is a surface of the solid, the cap. The ball has
/// no parameters: the cap does not move, and its rim moves with f.
#[derive(Clone, Copy, Debug)]
pub struct Clipped<F, R: Real> {
    inner: F,
    ball: Sphere<R>,
}

impl<F: Field<R>, R: Real> Clipped<F, R> {
    /// Clips `inner` to `ball`.
    pub fn new(inner: F, ball: Sphere<R>) -> Self {
        Clipped { inner, ball }
    }

    /// The signed distance to the sphere, and its gradient.
    fn sphere(&self, x: R::Vec3) -> (R, R::Vec3) {
        let away = x - self.ball.center;
        let length = away.length();
        (length - self.ball.radius, away * (R::one() / length.max(R::min_positive_value())))
    }

    /// The points where F is the distance to the sphere. `f` has the values of the inner field.
    fn on_sphere<'a>(&'a self, x: &'a [R::Vec3], f: &'a [R]) -> impl Iterator<Item = bool> + 'a {
        x.iter().zip(f).map(|(x, f)| self.sphere(*x).0 > *f)
    }

    fn inner_values(&self, x: &[R::Vec3]) -> Vec<R> {
        let mut f = vec![R::zero(); x.len()];
        self.inner.value(x, &mut f);
        f
    }

    /// The adjoints of values and gradients of the inner field.
    fn of_inner(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3]) -> (Vec<R>, Vec<R::Vec3>) {
        let f = self.inner_values(x);
        let (mut alpha, mut c) = (alpha.to_vec(), c.to_vec());
        for (i, on_sphere) in self.on_sphere(x, &f).enumerate() {
            if on_sphere {
                (alpha[i], c[i]) = (R::zero(), R::Vec3::zero());
            }
        }
        (alpha, c)
    }
}

/// Points of a sphere at which [`may_reach`] takes f. They are at most 0.045 radii from any other.
const SPHERE_POINTS: usize = 4096;

/// The largest distance of a point of a sphere from one of the [`SPHERE_POINTS`], in radii, with a
/// third more for slopes that grow between them.
const SPHERE_GAP: f64 = 0.06;

/// Whether the solid of a field may reach the sphere of a ball: f may fall to zero between the
/// points of the sphere where it is taken. It costs 4096 evaluations with gradients.
pub fn may_reach<R: Real>(field: &dyn Field<R>, ball: &Sphere<R>) -> bool {
    let point = |i| {
        let direction = <R::Vec3 as Vector3<R>>::of(fibonacci_direction(i, SPHERE_POINTS, 0.0));
        ball.center + direction * ball.radius
    };
    let x: Vec<R::Vec3> = (0..SPHERE_POINTS).map(point).collect();
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![x[0]; x.len()]);
    field.value_gradient(&x, &mut f, &mut gradient);
    let gap = R::of(SPHERE_GAP) * ball.radius;
    f.iter().zip(&gradient).any(|(f, gradient)| *f <= gap * gradient.length())
}

impl<F: Field<R>, R: Real> Field<R> for Clipped<F, R> {
    fn parameter_count(&self) -> usize {
        self.inner.parameter_count()
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        Some(self.ball)
    }

    fn is_lipschitz(&self) -> bool {
        self.inner.is_lipschitz()
    }

    fn has_creases(&self) -> bool {
        true
    }

    fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
        self.inner.faces(x, face);
        let f = self.inner_values(x);
        for (face, on_sphere) in face.iter_mut().zip(self.on_sphere(x, &f)) {
            *face = if on_sphere { mixed(1, 0) } else { mixed(0, *face) };
        }
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        self.inner.value(x, f);
        for (x, f) in x.iter().zip(f) {
            let distance = self.sphere(*x).0;
            if distance > *f {
                *f = distance;
            }
        }
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        self.inner.value_gradient(x, f, gradient);
        for ((x, f), gradient) in x.iter().zip(f).zip(gradient) {
            let (distance, normal) = self.sphere(*x);
            if distance > *f {
                (*f, *gradient) = (distance, normal);
            }
        }
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        self.inner.hessian_vector(x, p, gradient, product);
        let f = self.inner_values(x);
        for (i, on_sphere) in self.on_sphere(x, &f).enumerate() {
            if on_sphere {
                let (distance, normal) = self.sphere(x[i]);
                let length = distance + self.ball.radius;
                gradient[i] = normal;
                product[i] = (p[i] - normal * normal.dot(p[i]))
                    * (R::one() / length.max(R::min_positive_value()));
            }
        }
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        let (alpha, c) = self.of_inner(x, alpha, c);
        self.inner.parameter_vjp(x, &alpha, &c, adjoint);
    }

    fn table(&self) -> Range<usize> {
        self.inner.table()
    }

    fn add_parameter_vjp(
        &self,
        x: &[R::Vec3],
        alpha: &[R],
        c: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        let (alpha, c) = self.of_inner(x, alpha, c);
        self.inner.add_parameter_vjp(x, &alpha, &c, sum);
    }

    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        self.inner.parameter_jvp(x, tangent, f, gradient);
        let values = self.inner_values(x);
        for (i, on_sphere) in self.on_sphere(x, &values).enumerate() {
            if on_sphere {
                (f[i], gradient[i]) = (R::zero(), R::Vec3::zero());
            }
        }
    }
}
