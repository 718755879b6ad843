//! Balls that bound fields.

use glam::DVec3;

use crate::real::{Real, Vector3};

/// A ball of world space, used as the bound of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere<R: Real> {
    /// The centre, in world units.
    pub center: R::Vec3,
    /// The radius, in world units.
    pub radius: R,
}

impl<R: Real> Sphere<R> {
    /// Clips the ray o + t d, t ≥ 0, with |d| = 1: the first and last t inside the ball, in world
    /// units.
    ///
    /// `None` if the ray misses the ball, or if origin or direction are not finite numbers.
    pub fn clip(&self, origin: R::Vec3, direction: R::Vec3) -> Option<(R, R)> {
        let to_center = self.center - origin;
        let along = to_center.dot(direction);
        // The vector from the ray's line to the centre. The textbook |o − c|² − along² loses its
        // digits to cancellation when the origin is far away.
        let across = to_center - direction * along;
        let half_square = self.radius * self.radius - across.dot(across);
        // Comparisons with a NaN are false, so a ray with a NaN misses.
        if half_square >= R::zero() && along + half_square.sqrt() > R::zero() {
            let half = half_square.sqrt();
            Some(((along - half).max(R::zero()), along + half))
        } else {
            None
        }
    }

    /// The smallest ball that contains both balls.
    pub fn union(&self, other: &Self) -> Self {
        let between = other.center - self.center;
        let distance = between.length();
        if distance + other.radius <= self.radius {
            return *self;
        }
        if distance + self.radius <= other.radius {
            return *other;
        }
        let radius = (distance + self.radius + other.radius) * R::of(0.5);
        Sphere { center: self.center + between * ((radius - self.radius) / distance), radius }
    }

    /// The ball with the same centre and `factor` times the radius.
    pub fn scaled(&self, factor: R) -> Self {
        Sphere { center: self.center, radius: self.radius * factor }
    }
}

impl Sphere<f64> {
    /// The origin of coordinates in which single precision can describe the ball: its centre where
    /// that is further from the world's origin than the radius, else the world's origin.
    ///
    /// Rounding grows with the distance from the origin. In the second case it is at most twice
    /// that about the centre, and coordinates keep their bits.
    pub fn precise_origin(&self) -> DVec3 {
        if self.center.length() > self.radius { self.center } else { DVec3::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec3;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-3.0..3.0f64).prop_map(DVec3::from)
    }

    proptest! {
        #[test]
        fn clip_ends_lie_on_the_sphere(
            o in point(),
            d in point(),
            c in point(),
            radius in 0.1..2.0f64,
        ) {
            prop_assume!(d.length() > 0.1);
            let (d, sphere) = (d.normalize(), Sphere::<f64> { center: c, radius });
            if let Some((near, far)) = sphere.clip(o, d) {
                prop_assert!(near <= far);
                assert_relative_eq!((o + far * d - c).length(), radius, epsilon = 1e-7);
                if near > 0.0 {
                    assert_relative_eq!((o + near * d - c).length(), radius, epsilon = 1e-7);
                } else {
                    prop_assert!((o - c).length() <= radius + 1e-9);
                }
            }
        }

        #[test]
        fn union_contains_both_balls(
            a in point(),
            ra in 0.0..2.0f64,
            b in point(),
            rb in 0.0..2.0f64,
        ) {
            let a = Sphere::<f64> { center: a, radius: ra };
            let b = Sphere { center: b, radius: rb };
            let both = a.union(&b);
            for s in [a, b] {
                prop_assert!((s.center - both.center).length() + s.radius <= both.radius + 1e-9);
            }
        }
    }

    #[test]
    fn a_ray_with_nan_misses() {
        let sphere = Sphere::<f64> { center: DVec3::ZERO, radius: 1.0 };
        assert_eq!(sphere.clip(DVec3::NAN, DVec3::X), None);
        assert_eq!(sphere.clip(DVec3::splat(-5.0), DVec3::new(f64::NAN, 0.0, 0.0)), None);
    }
}
