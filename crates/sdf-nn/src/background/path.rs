//! The points of a ray behind the bounding sphere, in contracted coordinates.

use field::RayAdjoint;
use field::{Real, Vector3};

/// Points of a ray.
pub(crate) const POINTS: usize = 16;

/// The distance, in bounding radii, of points that only their direction tells apart.
const INFINITY: f64 = 1e6;

/// The least half of a chord of the sphere, in bounding radii, for the slope of its end.
const LEAST_ROOT: f64 = 1e-6;

/// A ray in coordinates relative to the bounding sphere: its centre is 0, its radius 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path<R: Real> {
    origin: R::Vec3,
    direction: R::Vec3,
    /// The distance at which the parts of the ray begin.
    start: R,
    /// Its derivative by o·d.
    slope: R,
    /// Its derivative by −|o|²/2.
    slope_out: R,
    /// The place of the point in each part of the ray, as a fraction of the part.
    place: R,
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
    /// The ray from `origin` along the unit vector `direction`, with its points at the fraction
    /// `place` of their parts.
    ///
    /// A ray begins where it leaves the sphere. A ray that misses the sphere begins before it
    /// passes: for rays close to each other on both sides of the outline, the beginnings are close,
    /// and a table beside the sphere has points before and behind the sphere's middle.
    pub(crate) fn new(origin: R::Vec3, direction: R::Vec3, place: R) -> Self {
        let (zero, one) = (R::zero(), R::one());
        let b = origin.dot(direction);
        let square = b * b - origin.dot(origin) + one;
        let root = square.abs().sqrt().max(R::of(LEAST_ROOT));
        let start = if square > zero { root - b } else { -root - b };
        let (slope, slope_out) = (b / root - one, root.recip());
        // A sphere behind the eye has no part.
        if start > zero {
            Path { origin, direction, start, slope, slope_out, place }
        } else {
            Path { origin, direction, start: zero, slope: zero, slope_out: zero, place }
        }
    }

    /// Step number `i` of the ray. The lengths grow with the distance.
    pub(crate) fn step(&self, i: usize) -> Step<R> {
        let (n, k) = (R::of(POINTS as f64), R::of(i as f64));
        let length =
            if i + 1 == POINTS { R::infinity() } else { far((k + R::one()) / n) - far(k / n) };
        Step { y: self.origin + self.direction * self.distance(i), length }
    }

    /// The distance of the point of a step. A place just below 1 can round to the end of the last
    /// part, which is infinitely far away.
    fn distance(&self, i: usize) -> R {
        let part = (R::of(i as f64) + self.place) / R::of(POINTS as f64);
        (self.start + far(part)).min(R::of(INFINITY))
    }

    /// A point so far along the ray that its contraction is the end of the ray.
    pub(crate) fn infinity(&self) -> R::Vec3 {
        self.direction * R::of(INFINITY)
    }

    /// The adjoint of the ray, from that of [`infinity`](Self::infinity).
    pub(crate) fn infinity_vjp(&self, y: R::Vec3) -> RayAdjoint<R> {
        RayAdjoint { origin: R::Vec3::zero(), direction: y * R::of(INFINITY) }
    }

    /// The adjoint of the ray, from that of a step's point.
    pub(crate) fn vjp(&self, i: usize, y: R::Vec3) -> RayAdjoint<R> {
        let start = y.dot(self.direction);
        RayAdjoint {
            origin: y + self.direction * (start * self.slope)
                - self.origin * (start * self.slope_out),
            direction: y * self.distance(i) + self.origin * (start * self.slope),
        }
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
