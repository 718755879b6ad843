//! A Lambertian shader with shadows.

use std::fmt;

use field::{
    Field, Precision, Real, Scalar, Shader, Sphere, SurfaceAdjoint, SurfaceBatch, Vector3,
};

use super::analytic::{ALL_LIT, Analytic, Formula, Light};

/// A Lambertian shader whose lights are blocked by the solid itself.
///
/// Its derivatives hold the visibility of the lights fixed: they do not contain the motion of the
/// edges of shadows.
pub struct Shadowed<'a, R: Real> {
    /// The shader without shadows.
    pub analytic: Analytic<R>,
    /// The field whose solid blocks light.
    pub occluders: &'a dyn Field<R>,
    /// The ball, in world units, in which shadow rays are traced.
    pub bounds: Sphere<R>,
}

impl<R: Real> fmt::Debug for Shadowed<'_, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Shadowed");
        shown.field("analytic", &self.analytic).field("bounds", &self.bounds);
        shown.finish_non_exhaustive()
    }
}

/// The height above the surface at which a shadow ray starts, in bounding radii: more than the
/// error of a hit in single precision, too little to show in a picture.
const SHADOW_OFFSET: f64 = 1e-3;

impl<R: Precision> Shadowed<'_, R> {
    /// The mask of the lights that reach each point: bit i is set for light i.
    ///
    /// A light below the horizon of a point counts as lit: its cosine is 0.
    fn lit(&self, x: &[R::Vec3], n: &[R::Vec3]) -> Vec<u64> {
        let Formula::Lambert { lights } = &self.analytic.formula else {
            return vec![ALL_LIT; x.len()];
        };
        let mut lit = vec![0; x.len()];
        let offset = self.bounds.radius * <R as Real>::of(SHADOW_OFFSET);
        for (l, light) in lights.iter().enumerate() {
            let p = &self.analytic.parameters[6 + 6 * l..];
            let p = R::Vec3::new(p[0], p[1], p[2]);
            let (mut rays, mut owners, mut found) = (Vec::new(), Vec::new(), Vec::new());
            for (i, (x, n)) in x.iter().zip(n).enumerate() {
                let origin = *x + *n * offset;
                let to_light = if *light == Light::Point { p - origin } else { p };
                let direction = to_light * (R::one() / to_light.length());
                lit[i] |= 1 << l;
                if n.dot(direction) > R::zero()
                    && let Some(mut ray) = trace::Ray::enter(origin, direction, &self.bounds)
                {
                    if *light == Light::Point {
                        ray.far = Scalar::min(ray.far, to_light.length());
                    }
                    rays.push(ray);
                    owners.push(i);
                }
            }
            trace::intersect(self.occluders, &rays, &trace::Options::default(), &mut found);
            for (i, found) in owners.into_iter().zip(found) {
                if found.outcome != trace::Outcome::Miss {
                    lit[i] &= !(1 << l);
                }
            }
        }
        lit
    }
}

impl<R: Precision> Shader<R> for Shadowed<'_, R> {
    fn parameter_count(&self) -> usize {
        self.analytic.parameter_count()
    }

    fn has_shadow_edges(&self) -> bool {
        true
    }

    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        let SurfaceBatch { x, normal: n, .. } = *points;
        for (i, lit) in self.lit(x, n).into_iter().enumerate() {
            rgb[i] = self.analytic.point_radiance(x[i], n[i], lit);
        }
    }

    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        let SurfaceBatch { x, normal: n, .. } = *points;
        bars.direction.fill(R::Vec3::zero());
        for (p, lit) in self.lit(x, n).into_iter().enumerate() {
            [bars.x[p], bars.normal[p]] =
                self.analytic.point_vjp(x[p], n[p], lit, adjoint[p], parameters);
        }
    }
}
