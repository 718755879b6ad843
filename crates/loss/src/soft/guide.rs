//! The term of known depths.

use estimate::record::PointAdjoint;
use glam::Vec3;
use multiview::stereo::{GuidedRay, guide};
use random::{Purpose, Stream};
use render::Sample;

use crate::part::Part;

/// The weight of a pixel's term, in units of its photometric loss: a surface that is off by a tenth
/// of the bounding radius counts as much as an error of a tenth of white.
const WEIGHT: f32 = 1.0;

impl Part<'_> {
    /// Adds the term of known depths for the pixels that have one.
    pub(super) fn add_guide(&mut self, samples: &[Sample]) {
        let Some(depths) = self.batch.depths else { return };
        let scene = &self.batch.scene;
        let ray = |(pixel, sample): (&crate::photometry::Pixel, &Sample)| {
            let distance = depths.distance(sample.camera, sample.u)?;
            let ray = scene.background_ray(sample);
            let weight = WEIGHT * self.share * f32::from(pixel.count);
            Some(GuidedRay { origin: ray.origin, direction: ray.direction, distance, weight })
        };
        let rays: Vec<GuidedRay> = self.pixels.iter().zip(samples).filter_map(ray).collect();
        let stream = Stream::new(self.seed, Purpose::FreePoints);
        for (x, alpha) in guide(scene.field, &scene.bounding_ball(), &rays, stream) {
            self.adjoints.push(PointAdjoint { pixel: 0, x, alpha, c: Vec3::ZERO });
        }
    }
}
