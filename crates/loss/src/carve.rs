//! Carving: surfaces that the photographs contradict go back.

use estimate::record::PointAdjoint;
use glam::Vec3;

use crate::part::Part;

/// The push of a surface point, in units of the term of a known depth.
const STRENGTH: f32 = 20.0;

/// A point stays if a depth map has its surface within this distance, in bounding radii.
const NEAR: f32 = 0.03;

impl Part<'_> {
    /// Pushes f up at points of the surface whose pixels have a large loss, unless a depth map has
    /// its surface there, or it is overexposed. `pushes` has one push for each pixel.
    pub(crate) fn carve(&mut self, pushes: &[f32]) {
        let Some(depths) = self.batch.depths else { return };
        let scene = &self.batch.scene;
        let (radius, near) = (scene.radius(), f64::from(NEAR * scene.radius()));
        for (pixel, x) in self.surface.iter().copied().filter(|(pixel, _)| pushes[*pixel] > 0.0) {
            let (view, at) = (self.pixels[pixel].view as usize, x.as_dvec3());
            let is_kept = depths.is_surface(scene.cameras, at, near)
                || self.batch.level.is_overexposed(scene.cameras, view, at);
            if !is_kept {
                let weight = self.share * f32::from(self.pixels[pixel].count);
                let alpha = -STRENGTH * pushes[pixel] * weight / radius;
                self.adjoints.push(PointAdjoint { pixel: 0, x, alpha, c: Vec3::ZERO });
            }
        }
    }
}
