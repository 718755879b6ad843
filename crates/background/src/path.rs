//! The points of a ray outside the bounding sphere, in contracted coordinates.

use field::{Real, Vector3};

/// Points of a ray before the sphere, and as many behind it.
const HALF: usize = 16;

/// Points of a ray.
pub(crate) const POINTS: usize = 2 * HALF;

/// The distance, in bounding radii, of points that only their direction tells apart.
const INFINITY: f64 = 1e6;

/// A ray in coordinates relative to the bounding sphere: its centre is 0, its radius 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path<R: Real> {
    origin: R::Vec3,
    direction: R::Vec3,
    /// The distances at which the ray enters and leaves the sphere, or passes it.
    ends: [R; 2],
    /// Their derivatives by o·d.
    slopes: [R; 2],
}

/// A part of a ray with a point in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step<R: Real> {
    /// The point.
    pub(crate) y: R::Vec3,
    /// The length of the part, in bounding radii; infinite for the last.
    pub(crate) length: R,
}

/// Distance behind the sphere at the fraction `part` of the steps there.
fn far<R: Real>(part: R) -> R {
    part / (R::one() - part)
}

impl<R: Real> Path<R> {
    /// The ray from `origin` along the unit vector `direction`.
    pub(crate) fn new(origin: R::Vec3, direction: R::Vec3) -> Self {
        let (zero, one) = (R::zero(), R::one());
        let b = origin.dot(direction);
        let square = b * b - origin.dot(origin) + one;
        let (ends, slopes) = if b >= zero {
            // The sphere is behind the eye, or the eye is inside of it.
            ([zero; 2], [zero; 2])
        } else if square > zero {
            let root = square.sqrt();
            ([(-b - root).max(zero), -b + root], [-one - b / root, -one + b / root])
        } else {
            ([-b; 2], [-one; 2])
        };
        Path { origin, direction, ends, slopes }
    }

    /// Step number `i` of the ray: equal lengths before the sphere, and growing ones behind it.
    pub(crate) fn step(&self, i: usize) -> Step<R> {
        let (at, length) = self.place(i);
        Step { y: self.origin + self.direction * at, length }
    }

    /// The distance of the point of a step, and the length of the step.
    fn place(&self, i: usize) -> (R, R) {
        let (n, half) = (R::of(HALF as f64), R::of(0.5));
        let k = R::of((i % HALF) as f64);
        if i < HALF {
            let length = self.ends[0] / n;
            return (length * (k + half), length);
        }
        let length =
            if i + 1 == POINTS { R::infinity() } else { far((k + R::one()) / n) - far(k / n) };
        (self.ends[1] + far((k + half) / n), length)
    }

    /// A point so far along the ray that its contraction is the end of the ray.
    pub(crate) fn infinity(&self) -> R::Vec3 {
        self.direction * R::of(INFINITY)
    }

    /// The adjoint of the direction, from that of [`infinity`](Self::infinity).
    pub(crate) fn infinity_vjp(&self, y: R::Vec3) -> R::Vec3 {
        y * R::of(INFINITY)
    }

    /// Adds the adjoint of the direction, from those of a step's point and length.
    pub(crate) fn vjp(&self, i: usize, y: R::Vec3, length: R, direction: &mut R::Vec3) {
        let (at, _) = self.place(i);
        *direction += y * at;
        let (n, along) = (R::of(HALF as f64), y.dot(self.direction));
        let slope = if i < HALF {
            let share = (R::of(i as f64) + R::of(0.5)) / n;
            (along * share + length / n) * self.slopes[0]
        } else {
            along * self.slopes[1]
        };
        *direction += self.origin * slope;
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
