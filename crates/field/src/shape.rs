//! Analytic signed distances: sphere, box, torus, capsule and plane.
//!
//! Formulas: J. C. Hart, “Sphere tracing: a geometric method for the antialiased ray tracing of
//! implicit surfaces”, The Visual Computer 12, 1996, appendix.

use crate::dual::{Dual, Scalar};
use crate::field::Field;
use crate::real::{Real, Vector3};
use crate::sphere::Sphere;

/// The kind of an analytic shape.
///
/// Each kind lists its parameters in the order of the flat vector θ, with the number of components
/// of a vector. All lengths and positions are in world units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `center` (3), `radius`.
    Sphere,
    /// `center` (3), `half_size` (3): a box with its edges along the coordinate axes.
    Box,
    /// `center` (3), `axis` (3, any length except 0), `major`, `minor`: the points within `minor`
    /// of the circle of radius `major` about the axis.
    Torus,
    /// `a` (3), `b` (3), `radius`: the points within `radius` of the segment from a to b.
    Capsule,
    /// `normal` n (3, any length except 0), `offset`: f = x·n/|n| − offset. The normal points out
    /// of the solid, a half-space.
    Plane,
}

impl Kind {
    /// The name and number of components of every parameter, in the order of the flat vector.
    pub fn layout(self) -> &'static [(&'static str, usize)] {
        match self {
            Kind::Sphere => &[("center", 3), ("radius", 1)],
            Kind::Box => &[("center", 3), ("half_size", 3)],
            Kind::Torus => &[("center", 3), ("axis", 3), ("major", 1), ("minor", 1)],
            Kind::Capsule => &[("a", 3), ("b", 3), ("radius", 1)],
            Kind::Plane => &[("normal", 3), ("offset", 1)],
        }
    }

    /// The length of the flat vector.
    pub fn parameter_count(self) -> usize {
        self.layout().iter().map(|(_, n)| n).sum()
    }
}

type Vec3<S> = [S; 3];

/// The point that positions are relative to, in world units; `None` for the world's origin.
type Origin<R> = Option<[R; 3]>;

#[inline(always)]
fn sub<S: Scalar>(a: Vec3<S>, b: Vec3<S>) -> Vec3<S> {
    std::array::from_fn(|i| a[i] - b[i])
}

#[inline(always)]
fn dot<S: Scalar>(a: Vec3<S>, b: Vec3<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The first three parameters of a slice.
#[inline(always)]
fn first_three<S: Scalar>(p: &[S]) -> Vec3<S> {
    [p[0], p[1], p[2]]
}

fn constant<S: Scalar>(value: f64) -> S {
    S::constant(S::Real::of(value))
}

/// The signed distance of `x` to a shape with parameters `p`. All derivatives come from this
/// formula.
fn distance<S: Scalar>(kind: Kind, p: &[S], x: Vec3<S>, origin: Origin<S::Real>) -> S {
    match kind {
        Kind::Sphere => sphere_distance(p, x),
        Kind::Box => box_distance(p, x),
        Kind::Torus => torus_distance(p, x),
        Kind::Capsule => capsule_distance(p, x),
        Kind::Plane => plane_distance(p, x, origin),
    }
}

#[inline]
fn sphere_distance<S: Scalar>(p: &[S], x: Vec3<S>) -> S {
    let r = sub(x, first_three(p));
    dot(r, r).sqrt() - p[3]
}

#[inline]
fn box_distance<S: Scalar>(p: &[S], x: Vec3<S>) -> S {
    let r = sub(x, first_three(p));
    let q: Vec3<S> = std::array::from_fn(|i| r[i].abs() - p[3 + i]);
    let outside = q.map(|c| c.max(constant(0.0)));
    let inside = q[0].max(q[1]).max(q[2]).min(constant(0.0));
    dot(outside, outside).sqrt() + inside
}

#[inline]
fn torus_distance<S: Scalar>(p: &[S], x: Vec3<S>) -> S {
    let r = sub(x, first_three(p));
    let axis = first_three(&p[3..]);
    let along = dot(r, axis) / dot(axis, axis).sqrt();
    let radial = (dot(r, r) - along * along).max(constant(0.0)).sqrt() - p[6];
    (radial * radial + along * along).sqrt() - p[7]
}

#[inline]
fn capsule_distance<S: Scalar>(p: &[S], x: Vec3<S>) -> S {
    let (a, b) = (first_three(p), first_three(&p[3..]));
    let (r, e) = (sub(x, a), sub(b, a));
    let square = dot(e, e);
    // A segment of length 0 is the point a: the capsule is a sphere.
    let fraction = if square.real() == num_traits::Zero::zero() {
        constant(0.0)
    } else {
        (dot(r, e) / square).max(constant(0.0)).min(constant(1.0))
    };
    let from_segment: Vec3<S> = std::array::from_fn(|i| r[i] - e[i] * fraction);
    dot(from_segment, from_segment).sqrt() - p[6]
}

#[inline]
fn plane_distance<S: Scalar>(p: &[S], x: Vec3<S>, origin: Origin<S::Real>) -> S {
    let n = first_three(p);
    let f = dot(x, n) / dot(n, n).sqrt() - p[3];
    // The plane turns about the world's origin. The value is that of `x`: the offset is relative.
    origin.map_or(f, |origin| {
        let turn = dot(origin.map(S::constant), n) / dot(n, n).sqrt();
        f + (turn - S::constant(turn.real()))
    })
}

/// The largest number of parameters of a kind: the torus has 8.
const MAX_PARAMETERS: usize = 8;

/// One analytic shape with its parameters.
///
/// Values are exact signed distances, negative inside, in world units. (A torus with `minor` >
/// `major` overlaps itself: inside it, the values are only bounds.) Derivatives come from [`Dual`]
/// numbers. Gradients do not exist on the medial axis, for example at a sphere's centre: there the
/// derivative of a square root of 0 is set to 0.
#[derive(Clone, Debug)]
pub struct Shape<R> {
    kind: Kind,
    /// Relative to `origin`.
    parameters: Vec<R>,
    origin: Origin<R>,
}

impl<R: Real + Scalar<Real = R>> Shape<R> {
    /// A shape from its flat parameters, in the order of [`Kind::layout`].
    ///
    /// # Panics
    /// If the number of parameters is not [`Kind::parameter_count`].
    pub fn new(kind: Kind, parameters: &[f64]) -> Self {
        Self::about([0.0; 3], kind, parameters)
    }

    /// The shape of [`new`](Self::new) in coordinates relative to the point `origin`, in world
    /// units.
    ///
    /// A small shape far from the world's origin keeps its digits in single precision only relative
    /// to a point near it. Derivatives are by the flat parameters of the world.
    ///
    /// # Panics
    /// If the number of parameters is not [`Kind::parameter_count`].
    pub fn about(origin: [f64; 3], kind: Kind, parameters: &[f64]) -> Self {
        assert_eq!(parameters.len(), kind.parameter_count(), "number of parameters of {kind:?}");
        let mut parameters = parameters.to_vec();
        let mut subtract = |start: usize| (0..3).for_each(|i| parameters[start + i] -= origin[i]);
        match kind {
            Kind::Sphere | Kind::Box | Kind::Torus => subtract(0),
            Kind::Capsule => [0, 3].into_iter().for_each(subtract),
            Kind::Plane => {
                let n = first_three(&parameters);
                parameters[3] -= dot(origin, n) / Scalar::sqrt(dot(n, n));
            }
        }
        Shape {
            kind,
            parameters: parameters.into_iter().map(R::of).collect(),
            origin: (origin != [0.0; 3]).then(|| origin.map(R::of)),
        }
    }

    /// A sphere, in world units.
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self::new(Kind::Sphere, &[center[0], center[1], center[2], radius])
    }

    fn vector(&self, start: usize) -> R::Vec3 {
        R::Vec3::new(self.parameters[start], self.parameters[start + 1], self.parameters[start + 2])
    }

    /// The signed distance of `x` in the number type `S`, with parameters converted by `parameter`.
    fn evaluate<S: Scalar<Real = R>>(&self, parameter: impl Fn(usize, R) -> S, x: Vec3<S>) -> S {
        let mut p = [S::constant(R::zero()); MAX_PARAMETERS];
        for (i, &value) in self.parameters.iter().enumerate() {
            p[i] = parameter(i, value);
        }
        distance(self.kind, &p[..self.parameters.len()], x, self.origin)
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

    fn is_lipschitz(&self) -> bool {
        true
    }

    fn has_creases(&self) -> bool {
        self.kind == Kind::Box
    }

    fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
        if self.kind != Kind::Box {
            face.fill(0);
            return;
        }
        let (center, half_size) = (self.vector(0), self.vector(3));
        for (x, face) in x.iter().zip(face) {
            let r = (*x - center).to_array();
            let half_size = half_size.to_array();
            // The side that the point is furthest out of.
            let axis = (1..3).fold(0, |best, axis| {
                let out = |axis: usize| Scalar::abs(r[axis]) - half_size[axis];
                if out(axis) > out(best) { axis } else { best }
            });
            *face = 2 * axis as u32 + u32::from(r[axis] > R::zero());
        }
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        for (x, f) in x.iter().zip(f) {
            *f = distance(self.kind, &self.parameters, x.to_array(), self.origin);
        }
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        for ((x, f), g) in x.iter().zip(f).zip(gradient) {
            let x = x.to_array();
            let point = std::array::from_fn(|i| Dual::<R, 3>::variable(x[i], i));
            let y = self.evaluate(|_, p| Dual::lift(p), point);
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
            let point = std::array::from_fn(|i| {
                Dual::<_, 3>::variable(Dual::<R, 1> { value: x[i], d: [p[i]] }, i)
            });
            let y = self.evaluate(|_, p| Dual::lift(Dual::lift(p)), point);
            *g = R::Vec3::from_array(y.d.map(|d| d.value));
            *hp = R::Vec3::from_array(y.d.map(|d| d.d[0]));
        }
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        for ((x, &alpha), c) in x.iter().zip(alpha).zip(c) {
            let (x, c) = (x.to_array(), c.to_array());
            let point = std::array::from_fn(|i| {
                Dual::<_, 1>::lift(Dual::<R, 1> { value: x[i], d: [c[i]] })
            });
            for (j, out) in adjoint.iter_mut().enumerate() {
                let y =
                    self.evaluate(|i, p| Dual { value: Dual::lift(p), d: [seed(i == j)] }, point);
                *out += alpha * y.d[0].value + y.d[0].d[0];
            }
        }
    }

    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        for ((x, f), g) in x.iter().zip(f).zip(gradient) {
            let x = x.to_array();
            let point =
                std::array::from_fn(|i| Dual::<_, 1>::lift(Dual::<R, 3>::variable(x[i], i)));
            let y = self
                .evaluate(|i, p| Dual { value: Dual::lift(p), d: [Dual::lift(tangent[i])] }, point);
            *f = y.d[0].value;
            *g = R::Vec3::from_array(y.d[0].d);
        }
    }
}

/// 1 if `one`, else 0, as a constant: the derivative of a parameter by a parameter.
fn seed<R: Real + Scalar<Real = R>>(one: bool) -> Dual<R, 1> {
    Dual::lift(if one { R::one() } else { R::zero() })
}
