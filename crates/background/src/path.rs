//! The points of a ray behind the bounding sphere, in contracted coordinates.

use field::{Real, Vector3};

/// Points of a ray.
pub(crate) const POINTS: usize = 16;

/// The distance, in bounding radii, of points that only their direction tells apart.
const INFINITY: f64 = 1e6;

/// A ray in coordinates relative to the bounding sphere: its centre is 0, its radius 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path<R: Real> {
    origin: R::Vec3,
    direction: R::Vec3,
    /// The distance at which the ray leaves the sphere, or passes it.
    start: R,
    /// Its derivative by o·d.
    slope: R,
}

/// A part of a ray with a point in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step<R: Real> {
    /// The point.
    pub(crate) y: R::Vec3,
    /// The length of the part, in bounding radii; infinite for the last.
    pub(crate) length: R,
}

/// Distance from the start at the fraction `part` of the steps.
fn far<R: Real>(part: R) -> R {
    part / (R::one() - part)
}

impl<R: Real> Path<R> {
    /// The ray from `origin` along the unit vector `direction`.
    pub(crate) fn new(origin: R::Vec3, direction: R::Vec3) -> Self {
        let (zero, one) = (R::zero(), R::one());
        let b = origin.dot(direction);
        let square = b * b - origin.dot(origin) + one;
        let (start, slope) = if square > zero {
            let root = square.sqrt();
            (root - b, b / root - one)
        } else {
            (-b, -one)
        };
        // A sphere behind the eye has no part.
        let (start, slope) = if start > zero { (start, slope) } else { (zero, zero) };
        Path { origin, direction, start, slope }
    }

    /// Step number `i` of the ray. The lengths grow with the distance.
    pub(crate) fn step(&self, i: usize) -> Step<R> {
        let (n, k) = (R::of(POINTS as f64), R::of(i as f64));
        let length =
            if i + 1 == POINTS { R::infinity() } else { far((k + R::one()) / n) - far(k / n) };
        Step { y: self.origin + self.direction * self.place(i), length }
    }

    /// The distance of the point of a step.
    fn place(&self, i: usize) -> R {
        self.start + far((R::of(i as f64) + R::of(0.5)) / R::of(POINTS as f64))
    }

    /// A point so far along the ray that its contraction is the end of the ray.
    pub(crate) fn infinity(&self) -> R::Vec3 {
        self.direction * R::of(INFINITY)
    }

    /// The adjoint of the direction, from that of [`infinity`](Self::infinity).
    pub(crate) fn infinity_vjp(&self, y: R::Vec3) -> R::Vec3 {
        y * R::of(INFINITY)
    }

    /// The adjoint of the direction, from that of a step's point.
    pub(crate) fn vjp(&self, i: usize, y: R::Vec3) -> R::Vec3 {
        y * self.place(i) + self.origin * (y.dot(self.direction) * self.slope)
    }
}

/// The contraction of space to a ball of radius 2: points of the unit ball stay, and a point at the
/// distance r comes to 2 − 1/r.
///
/// Barron, Mildenhall, Verbin, Srinivasan and Hedman, "Mip-NeRF 360: Unbounded Anti-Aliased Neural
/// Radiance Fields", CVPR 2022, equation 10.
pub(crate) fn contract<R: Real>(y: R::Vec3) -> R::Vec3 {
    let r = y.length();
    if r <= R::one() { y } else { y * ((R::of(2.0) - r.recip()) / r) }
}

/// The adjoint of y ↦ [`contract`].
pub(crate) fn contract_vjp<R: Real>(y: R::Vec3, adjoint: R::Vec3) -> R::Vec3 {
    let r = y.length();
    if r <= R::one() {
        return adjoint;
    }
    let unit = y * r.recip();
    let (radial, across) = ((r * r).recip(), (R::of(2.0) - r.recip()) / r);
    let along = unit * unit.dot(adjoint);
    along * radial + (adjoint - along) * across
}
