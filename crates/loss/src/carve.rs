//! Carving: the fit removes surface behind pixels that contradict it.

use glam::Vec3;
use multiview::stereo::{Guide, pushes};

use crate::drawn::Drawn;
use crate::objective::Objective;
use crate::reversed::Reversed;

/// The push of a surface point, in units of the term of a known depth.
const STRENGTH: f32 = 20.0;

/// A point stays if a depth map has its surface within this distance, in bounding radii.
const NEAR: f32 = 0.03;

/// The push of each pixel of a round, if the objective carves; else empty. See [`pushes`].
pub(crate) fn pushes_of(
    round: &Objective<'_>,
    losses: impl Iterator<Item = Option<f32>>,
) -> Vec<f32> {
    if round.carving.is_none() {
        return Vec::new();
    }
    // `pushes` reads the losses more than once.
    let losses: Vec<Option<f32>> = losses.collect();
    pushes(losses.into_iter().zip(round.draws.iter().map(|draw| f32::from(draw.count))))
}

/// Pushes f up at points of the surface whose pixels have a large loss, unless a depth map has its
/// surface there, or it is overexposed. Each point of `surface` comes with the number of its pixel
/// in the part. `pushes` has one push for each pixel of the round, or is empty.
pub(crate) fn carve(
    drawn: &Drawn<'_>,
    surface: impl Iterator<Item = (usize, Vec3)>,
    pushes: &[f32],
    out: &mut Reversed,
) {
    let Some(depths) = drawn.objective.carving.filter(|_| !pushes.is_empty()) else { return };
    let pushes = &pushes[drawn.first..drawn.first + drawn.draws.len()];
    for (pixel, x) in surface.filter(|(pixel, _)| pushes[*pixel] > 0.0) {
        let draw = &drawn.draws[pixel];
        if is_carved(drawn.objective, &depths, draw.view as usize, x) {
            let weight = drawn.objective.pixel_weight() * f32::from(draw.count);
            let radius = drawn.objective.scene.radius();
            out.push_value(x, -STRENGTH * pushes[pixel] * weight / radius);
        }
    }
}

/// Whether a point of the surface in a view may be removed.
fn is_carved(objective: &Objective<'_>, depths: &Guide<'_>, view: usize, x: Vec3) -> bool {
    let (scene, x) = (&objective.scene, x.as_dvec3());
    let near = f64::from(NEAR * scene.radius());
    let is_kept = depths.is_surface(scene.cameras, x, near)
        || objective.targets.level.is_overexposed(scene.cameras, view, x);
    !is_kept
}
