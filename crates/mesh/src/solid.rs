//! The solid that is extracted: a field clipped to its bounding sphere.

#![warn(clippy::cast_possible_truncation)]

use field::{Field, Real, Sphere, Vector3};
use glam::DVec3;

/// The largest magnitude of F. It replaces infinities: it is far beyond any scene, and single
/// precision can interpolate with it.
const LARGEST_VALUE: f64 = 1e30;

/// The solid {F ≤ 0} with F = max(f, signed distance to the bounding sphere).
pub(crate) struct Solid<'a, R: Real> {
    field: &'a dyn Field<R>,
    bounds: Sphere<f64>,
    /// The value, above 0, that replaces a NaN of f: such a point is outside the solid.
    nan_value: f64,
}

impl<'a, R: Real> Solid<'a, R> {
    pub(crate) fn new(field: &'a dyn Field<R>, bounds: &Sphere<f64>, nan_value: f64) -> Self {
        Solid { field, bounds: *bounds, nan_value }
    }

    /// F(x), always finite.
    pub(crate) fn value(&self, x: &[DVec3]) -> Vec<f64> {
        let points: Vec<R::Vec3> = x.iter().map(|x| Vector3::of(*x)).collect();
        let mut f = vec![R::zero(); x.len()];
        self.field.value(&points, &mut f);
        x.iter().zip(&f).map(|(x, f)| self.clip(f.to_double(), self.sphere_distance(*x))).collect()
    }

    /// F(x), always finite, and ∇F(x).
    pub(crate) fn value_gradient(&self, x: &[DVec3]) -> Vec<(f64, DVec3)> {
        let points: Vec<R::Vec3> = x.iter().map(|x| Vector3::of(*x)).collect();
        let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
        self.field.value_gradient(&points, &mut f, &mut gradient);
        let clipped = |((x, f), gradient): ((&DVec3, &R), &R::Vec3)| {
            let sphere_distance = self.sphere_distance(*x);
            let value = self.clip(f.to_double(), sphere_distance);
            let is_sphere = sphere_distance >= value;
            let sphere_gradient = || (x - self.bounds.center).normalize_or_zero();
            (value, if is_sphere { sphere_gradient() } else { gradient.to_double() })
        };
        x.iter().zip(&f).zip(&gradient).map(clipped).collect()
    }

    /// The signed distance to the bounding sphere.
    fn sphere_distance(&self, x: DVec3) -> f64 {
        (x - self.bounds.center).length() - self.bounds.radius
    }

    fn clip(&self, f: f64, sphere_distance: f64) -> f64 {
        let f = if f.is_nan() { self.nan_value } else { f };
        f.max(sphere_distance).clamp(-LARGEST_VALUE, LARGEST_VALUE)
    }
}
