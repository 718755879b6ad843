//! The background force: a prior that clears surfaces in front of the background.

use estimate::record::PointAdjoint;
use glam::Vec3;
use render::Primary;
use trace::Outcome;

use super::chunk::Chunk;

/// Skip the background force where hit and colour agree up to this probability: its gradient is
/// negligible.
const NEGLIGIBLE: f32 = 1e-3;

impl Chunk<'_> {
    /// Increases f at a hit if the pixel looks like the background, and decreases f at the closest
    /// approach of a ray without a hit if the pixel does not.
    ///
    /// The coefficient of f is the weight of the force times the probability of the contradiction,
    /// over the bounding radius. It is a prior, and not a derivative of the image.
    pub(super) fn add_background_force(&mut self, primary: &Primary<f32>) {
        let radius = self.batch.scene.radius();
        let each = self.batch.weights.background * self.share / radius;
        if each == 0.0 {
            return;
        }
        let mut hit = vec![None; primary.samples.len()];
        primary.hits.iter().enumerate().for_each(|(h, at)| hit[at.sample] = Some(h));
        for (i, pixel) in self.pixels.iter().enumerate() {
            let weight = each * f32::from(pixel.count);
            let probability = self.background_probability(*pixel);
            let disagreement = if hit[i].is_some() { probability } else { 1.0 - probability };
            let traced = primary.ray_of(&primary.samples[i]);
            let inside = traced.is_some_and(|traced| traced.found.outcome == Outcome::Inside);
            if disagreement < NEGLIGIBLE && !inside {
                continue;
            }
            if let Some(h) = hit[i] {
                self.push_force(primary.surface.x[h], -weight * probability);
            } else if let Some(traced) = traced {
                let x = traced.ray.origin + traced.ray.direction * traced.found.t;
                // The ray starts inside the solid: the solid has reached the bounding sphere,
                // outside of which nothing is visible. Push it back.
                let alpha = if inside { -weight } else { weight * (1.0 - probability) };
                self.push_force(x, alpha);
            }
        }
    }

    /// Adds the coefficient α of f at a point.
    fn push_force(&mut self, x: Vec3, alpha: f32) {
        self.adjoints.push(PointAdjoint { pixel: 0, x, alpha, c: Vec3::ZERO });
    }
}
