//! The pixels that a silhouette may cross, from their own samples and from their corners.

use std::ops::Range;

use field::Real;
use render::{InvalidField, Pixel, Primary, Sample, Scene, TracedRay, TracedSample, pixel_samples};
use rustc_hash::FxHashMap;
use trace::Outcome;

use super::crease_margin::near_creases;
use crate::crossing::has_visible_creases;
use crate::estimator::{Batch, SilhouetteMask};
use crate::record::{Area, PixelWeight, Record};
use crate::silhouette_margin::{Passage, SilhouetteMargin, near_silhouettes, passages};

/// A ray through a corner that passes a surface by less than this, in pixels, can mark the pixels
/// at the corner: every point of a pixel is within √½ pixels of a corner. At 0.5 and 1.5 the errors
/// of the suite are the same; evaluations 0.999 and 1.004.
const CORNER_REACH: f64 = 0.75;

/// If a ray clears all surfaces by more than this, in pixels, no silhouette crosses its pixel.
/// √2 is enough if f is a distance; the rest is a margin for other fields. At 1.6 and 6.4 the
/// errors and the evaluations of the suite, whose networks have slopes near 1, are the same.
pub(super) const FAR: f64 = 3.2;

/// Adds the samples `range` of all unmarked pixels to the record, and marks the pixels that a
/// silhouette may cross according to these samples. Returns the pixels that remain unmarked, except
/// those with a ray that is far from all surfaces.
pub(super) fn sample_unmarked<R: Real>(
    scene: &Scene<'_, R>,
    batch: &Batch<'_>,
    range: Range<u32>,
    record: &mut Record<R>,
    mask: &mut SilhouetteMask,
) -> Result<Vec<u32>, InvalidField> {
    let unmarked: Vec<u32> =
        (0..batch.pixels.len() as u32).filter(|&i| !mask.may_cross[i as usize]).collect();
    let pixels: Vec<Pixel> = unmarked.iter().map(|&i| batch.pixels[i as usize]).collect();
    let primary = scene.primary(&pixel_samples(pixels.iter().copied(), &range, batch.stream))?;
    record.rays += primary.samples.len() as u64;
    let near = near_silhouettes(scene, &primary, SilhouetteMargin::SMALL);
    let seen = seen_faces(scene, &primary);
    let count = range.len();
    let creased = match has_visible_creases(scene) {
        true => near_creases(scene, &primary, &pixels, count),
        false => vec![false; pixels.len()],
    };
    let mixed = |own: &[Option<u32>]| own.iter().any(|face| *face != own[0]);
    let mut not_far = Vec::new();
    for (i, &pixel) in unmarked.iter().enumerate() {
        let own = i * count..(i + 1) * count;
        if near[own.clone()].contains(&true) || mixed(&seen[own.clone()]) || creased[i] {
            mask.may_cross[pixel as usize] = true;
        } else if !primary.samples[own].iter().any(|sample| is_far(scene, &primary, sample)) {
            not_far.push(pixel);
        }
    }
    let weight = R::one() / R::of(f64::from(batch.counts.spp));
    let in_pixel = |i: usize| PixelWeight { pixel: unmarked[i / count], weight };
    let weights = (0..primary.samples.len()).map(in_pixel).collect();
    record.area.push(Area::new(primary, weights));
    Ok(not_far)
}

/// The face that every sample hits, `None` for a miss. All faces are the same if the radiance does
/// not jump at creases.
fn seen_faces<R: Real>(scene: &Scene<'_, R>, primary: &Primary<R>) -> Vec<Option<u32>> {
    let mut face = vec![0; primary.hits.len()];
    if has_visible_creases(scene) {
        scene.field.faces(&primary.surface.x, &mut face);
    }
    let mut seen = vec![None; primary.samples.len()];
    for (hit, face) in primary.hits.iter().zip(face) {
        seen[hit.sample] = Some(face);
    }
    seen
}

/// Whether a ray clears all surfaces by so much that no silhouette can cross its pixel.
fn is_far<R: Real>(scene: &Scene<'_, R>, primary: &Primary<R>, sample: &TracedSample<R>) -> bool {
    let far = R::of(scene.cameras[sample.sample.camera].pixel_angle() * FAR);
    match primary.ray_of(sample) {
        Some(TracedRay { found, .. }) => {
            found.outcome == Outcome::Miss && found.clearance > far && found.clearance.is_finite()
        }
        None => scene.passing(&sample.sample).1 > far,
    }
}

/// The corners of pixels, without duplicates.
struct Corners {
    samples: Vec<Sample>,
    /// The samples of each pixel's four corners.
    of_pixel: Vec<[usize; 4]>,
}

impl Corners {
    fn of(pixels: impl Iterator<Item = Pixel>) -> Self {
        let (mut known, mut samples) = (FxHashMap::default(), Vec::new());
        let mut corner = |camera: usize, x: u32, y: u32| {
            *known.entry((camera, x, y)).or_insert_with(|| {
                samples.push(Sample { camera, u: Pixel { camera, x, y }.corner() });
                samples.len() - 1
            })
        };
        let of_pixel = pixels
            .map(|Pixel { camera, x, y }| {
                [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| corner(camera, x, y))
            })
            .collect();
        Corners { samples, of_pixel }
    }
}

/// The face that every corner ray hits; see [`seen_faces`].
fn corner_faces<R: Real>(
    scene: &Scene<'_, R>,
    traced: &[Option<TracedRay<R>>],
) -> Vec<Option<u32>> {
    let point = |traced: &TracedRay<R>| traced.depth().map(|t| traced.ray.at(t));
    let x: Vec<Option<R::Vec3>> =
        traced.iter().map(|traced| traced.as_ref().and_then(point)).collect();
    let hits: Vec<R::Vec3> = x.iter().flatten().copied().collect();
    let mut face = vec![0; hits.len()];
    if has_visible_creases(scene) {
        scene.field.faces(&hits, &mut face);
    }
    let mut face = face.into_iter();
    x.iter().map(|x| x.and_then(|_| face.next())).collect()
}

/// Marks the pixels among `which` of whose corner rays some hit and some miss, or one passes a
/// surface closely.
///
/// A straight silhouette (an edge of a solid) that cuts off a corner may show in no other ray of
/// the pixel.
pub(super) fn mark_corners<R: Real>(
    scene: &Scene<'_, R>,
    batch: &Batch<'_>,
    which: &[u32],
    record: &mut Record<R>,
    mask: &mut SilhouetteMask,
) -> Result<(), InvalidField> {
    let corners = Corners::of(which.iter().map(|&i| batch.pixels[i as usize]));
    let traced = scene.trace(&corners.samples)?;
    record.rays += traced.len() as u64;
    let seen = corner_faces(scene, &traced);
    let mut passed: Vec<Option<Passage>> = traced.iter().map(|_| None).collect();
    let corner_rays = corners.samples.iter().copied().zip(traced.iter().map(Option::as_ref));
    for passage in passages(scene, corner_rays, CORNER_REACH) {
        let sample = passage.sample;
        passed[sample] = Some(passage);
    }
    for (&index, four) in which.iter().zip(&corners.of_pixel) {
        let pixel = &batch.pixels[index as usize];
        let close = |i: usize| {
            let passage = passed[i].as_ref();
            passage.is_some_and(|p| p.crosses(&corners.samples[i], pixel, SilhouetteMargin::SMALL))
        };
        mask.may_cross[index as usize] = four.iter().any(|&i| seen[i] != seen[four[0]] || close(i));
    }
    Ok(())
}
