//! Analytic signed distances: sphere, box, torus, capsule, plane.

use crate::{Dual, Field, Real, Scalar, Sphere, Vector3};

/// The kind of an analytic shape; each documents the order of its parameters in the flat vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `center` (3), `radius`.
    Sphere,
    /// `center` (3), `half_size` (3); edges along the axes.
    Box,
    /// `center` (3), `axis` (3, any length but 0), `major`, `minor`.
    Torus,
    /// `a` (3), `b` (3), `radius`: all points within `radius` of the segment.
    Capsule,
    /// `normal` (3, any length but 0), `offset`: f = x·n/|n| − offset, solid below.
    Plane,
}

impl Kind {
    /// Names and lengths of the parameters, in the order of the flat vector.
    pub fn layout(self) -> &'static [(&'static str, usize)] {
        match self {
            Kind::Sphere => &[("center", 3), ("radius", 1)],
            Kind::Box => &[("center", 3), ("half_size", 3)],
            Kind::Torus => &[("center", 3), ("axis", 3), ("major", 1), ("minor", 1)],
            Kind::Capsule => &[("a", 3), ("b", 3), ("radius", 1)],
            Kind::Plane => &[("normal", 3), ("offset", 1)],
        }
    }

    /// The number of parameters.
    pub fn parameter_count(self) -> usize {
        self.layout().iter().map(|(_, n)| n).sum()
    }
}

type V<S> = [S; 3];

fn sub<S: Scalar>(a: V<S>, b: V<S>) -> V<S> {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot<S: Scalar>(a: V<S>, b: V<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn vector<S: Scalar>(p: &[S]) -> V<S> {
    [p[0], p[1], p[2]]
}

/// The signed distance of `x`, in any arithmetic; the one formula behind every derivative here.
fn distance<S: Scalar>(kind: Kind, p: &[S], x: V<S>) -> S {
    let constant = |v: f64| S::constant(S::Real::of(v));
    match kind {
        Kind::Sphere => {
            let r = sub(x, vector(p));
            dot(r, r).sqrt() - p[3]
        }
        Kind::Box => {
            let r = sub(x, vector(p));
            let q: V<S> = std::array::from_fn(|i| r[i].abs() - p[3 + i]);
            let outside = q.map(|c| c.max(constant(0.0)));
            let inside = q[0].max(q[1]).max(q[2]).min(constant(0.0));
            dot(outside, outside).sqrt() + inside
        }
        Kind::Torus => {
            let r = sub(x, vector(p));
            let axis = vector(&p[3..]);
            let along = dot(r, axis) / dot(axis, axis).sqrt();
            let radial = (dot(r, r) - along * along).max(constant(0.0)).sqrt() - p[6];
            (radial * radial + along * along).sqrt() - p[7]
        }
        Kind::Capsule => {
            let (a, b) = (vector(p), vector(&p[3..]));
            let (r, e) = (sub(x, a), sub(b, a));
            let square = dot(e, e);
            let h = if square.real() == num_traits::Zero::zero() {
                constant(0.0)
            } else {
                (dot(r, e) / square).max(constant(0.0)).min(constant(1.0))
            };
            let nearest: V<S> = std::array::from_fn(|i| r[i] - e[i] * h);
            dot(nearest, nearest).sqrt() - p[6]
        }
        Kind::Plane => {
            let n = vector(p);
            dot(x, n) / dot(n, n).sqrt() - p[3]
        }
    }
}

/// Room for the parameters of any kind on the stack.
const MAX_PARAMETERS: usize = 8;

/// One analytic shape with its parameters; distances are exact, negative inside.
///
/// Derivatives come from dual numbers through one formula. At the medial axis (a sphere's centre,
/// say), where the gradient does not exist, the derivative of a vanishing square root is taken as
/// 0.
#[derive(Clone, Debug)]
pub struct Shape<R> {
    kind: Kind,
    parameters: Vec<R>,
}

impl<R: Real + Scalar<Real = R>> Shape<R> {
    /// A shape from its flat parameters, in the order of [`Kind::layout`].
    ///
    /// # Panics
    /// If the number of parameters is not that of the kind.
    pub fn new(kind: Kind, parameters: &[f64]) -> Self {
        assert_eq!(parameters.len(), kind.parameter_count(), "parameters of {kind:?}");
        Shape { kind, parameters: parameters.iter().map(|&p| R::of(p)).collect() }
    }

    /// A sphere.
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self::new(Kind::Sphere, &[center[0], center[1], center[2], radius])
    }

    fn vector(&self, start: usize) -> R::Vec3 {
        R::Vec3::new(self.parameters[start], self.parameters[start + 1], self.parameters[start + 2])
    }

    /// Evaluates with the parameters and the point turned into `S` by the caller.
    fn eval<S: Scalar<Real = R>>(&self, parameter: impl Fn(usize, R) -> S, x: V<S>) -> S {
        let mut p = [S::constant(R::zero()); MAX_PARAMETERS];
        for (i, &value) in self.parameters.iter().enumerate() {
            p[i] = parameter(i, value);
        }
        distance(self.kind, &p[..self.parameters.len()], x)
    }
}

impl<R: Real + Scalar<Real = R>> Field<R> for Shape<R> {
    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let p = &self.parameters;
        let (center, radius) = match self.kind {
            Kind::Sphere => (self.vector(0), p[3]),
            Kind::Box => (self.vector(0), self.vector(3).length()),
            Kind::Torus => (self.vector(0), p[6] + p[7]),
            Kind::Capsule => {
                let (a, b) = (self.vector(0), self.vector(3));
                ((a + b) * R::of(0.5), (b - a).length() * R::of(0.5) + p[6])
            }
            Kind::Plane => return None,
        };
        Some(Sphere { center, radius })
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        for (x, f) in x.iter().zip(f) {
            *f = distance(self.kind, &self.parameters, x.to_array());
        }
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        for ((x, f), g) in x.iter().zip(f).zip(gradient) {
            let x = x.to_array();
            let at = std::array::from_fn(|i| Dual::<R, 3>::variable(x[i], i));
            let y = self.eval(|_, p| Dual::lift(p), at);
            *f = y.value;
            *g = R::Vec3::from_array(y.d);
        }
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        for (((x, p), g), hp) in x.iter().zip(p).zip(gradient).zip(product) {
            let (x, p) = (x.to_array(), p.to_array());
            let at = std::array::from_fn(|i| {
                Dual::<_, 3>::variable(Dual::<R, 1> { value: x[i], d: [p[i]] }, i)
            });
            let y = self.eval(|_, p| Dual::lift(Dual::lift(p)), at);
            *g = R::Vec3::from_array(y.d.map(|d| d.value));
            *hp = R::Vec3::from_array(y.d.map(|d| d.d[0]));
        }
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        for ((x, &alpha), c) in x.iter().zip(alpha).zip(c) {
            let (x, c) = (x.to_array(), c.to_array());
            let at = std::array::from_fn(|i| {
                Dual::<_, 1>::lift(Dual::<R, 1> { value: x[i], d: [c[i]] })
            });
            for (j, out) in adjoint.iter_mut().enumerate() {
                let y = self.eval(|i, p| Dual { value: Dual::lift(p), d: [unit(i == j)] }, at);
                *out += alpha * y.d[0].value + y.d[0].d[0];
            }
        }
    }

    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        for ((x, f), g) in x.iter().zip(f).zip(gradient) {
            let x = x.to_array();
            let at = std::array::from_fn(|i| Dual::<_, 1>::lift(Dual::<R, 3>::variable(x[i], i)));
            let y =
                self.eval(|i, p| Dual { value: Dual::lift(p), d: [Dual::lift(tangent[i])] }, at);
            *f = y.d[0].value;
            *g = R::Vec3::from_array(y.d[0].d);
        }
    }
}

/// One or zero, without derivatives.
fn unit<R: Real + Scalar<Real = R>>(one: bool) -> Dual<R, 1> {
    Dual::lift(if one { R::one() } else { R::zero() })
}
