//! The term of known depths.

use multiview::stereo::{Guide, GuidedRay, guide};
use random::Name;
use render::Sample;

use crate::drawn::Drawn;
use crate::photometry::Draw;
use crate::reversed::Reversed;

/// The weight of a pixel's term, in units of its photometric loss: a surface that is off by a tenth
/// of the bounding radius counts as much as an error of a tenth of white.
const WEIGHT: f32 = 1.0;

const FREE_POINTS: Name = Name::new("points of a ray in front of a known depth", 31);

/// Adds the term of known depths for the pixels that have one.
pub(super) fn add_guide(
    drawn: &Drawn<'_>,
    samples: &[Sample],
    depths: &Guide<'_>,
    out: &mut Reversed,
) {
    let scene = &drawn.objective.scene;
    let ray = |(draw, sample): (&Draw, &Sample)| {
        let distance = depths.distance(sample.camera, sample.u)?;
        let ray = scene.background_ray(sample);
        let weight = WEIGHT * drawn.objective.pixel_weight() * f32::from(draw.count);
        Some(GuidedRay { origin: ray.origin, direction: ray.direction, distance, weight })
    };
    let rays: Vec<GuidedRay> = drawn.draws.iter().zip(samples).filter_map(ray).collect();
    let stream = drawn.stream.named(FREE_POINTS);
    for (x, alpha) in guide(scene.field, &scene.bounding_ball(), &rays, stream) {
        out.push_value(x, alpha);
    }
}
