//! The schedule of a fit: functions of its progress.

use optim::Schedule;

// Evidence, here and for constants of the crate `fit` and of `photometry` that refer to it: one
// constant changed at a time, 1000 iterations on the demo's scene and on the stool of the sweeps
// (24 views of 128 × 128 pixels), two seeds each, before fits had a soft surface. "Distance" is the
// geometric mean of the four Chamfer distances, relative to that of the values in the code; its
// standard error is about 0.05. So a value within 0.9 to 1.1 cannot be told apart from the chosen
// one. docs/captures-compared.md compares the soft part, its sharpness, the levels and the octaves.

/// The progress at which each finer level of the pyramid starts, the finest last: the shape must be
/// fine while the surface is soft.
const FINER_FROM: [f64; 3] = [0.05, 0.12, 0.25];

/// The share of the budget that is spent on the finest level.
pub const FINEST_SHARE: f64 = 1.0 - FINER_FROM[2];

/// On the finest level, one draw stands for a group of this many certain background pixels: their
/// rays miss by then, and only a trained background has a gradient there. Before a uniform one,
/// groups of 4 and 16 had the distance 0.97 and 0.95.
const BACKGROUND_GROUP: usize = 8;

/// The same on coarser levels, where these pixels carve the object and train the background. With
/// groups of 1, a fit was as good and took longer.
const COARSE_GROUP: usize = 4;

/// The number of background pixels that one draw stands for.
pub fn background_group(progress: f64) -> usize {
    if progress >= FINER_FROM[2] { BACKGROUND_GROUP } else { COARSE_GROUP }
}

/// The shares of the sharp part at which the surface is surveyed: pixels far from it become certain
/// background, if the background is trained, and nodes of fine grids near it become free. The
/// surface has moved in between. docs/captures-compared.md has fits with and without such pixels.
const SURVEYS: [f64; 3] = [0.0, 0.2, 0.6];

/// The progress at which the surface is sharp at full size.
fn sharp_from(soft: f64) -> f64 {
    soft.max(FINER_FROM[2])
}

/// The spent fraction of the budget after that, 0 to 1.
fn sharp_share(progress: f64, soft: f64) -> f64 {
    let sharp = sharp_from(soft);
    if progress > sharp { (progress - sharp) / (1.0 - sharp) } else { 0.0 }
}

/// The number of surveys of the surface that are due, if it is soft for a share `soft` of the
/// budget.
pub fn surveys(progress: f64, soft: f64) -> u64 {
    let sharp = sharp_from(soft);
    SURVEYS.iter().filter(|share| progress >= sharp + *share * (1.0 - sharp)).count() as u64
}

/// The progress from which all octaves of the encodings have their full weight: the shape must be
/// fine while the surface is soft.
const BANDS_ON: f64 = 0.25;

/// The number of octaves with full weight at the start. With 1 and 4: distance 1.03 and 0.97.
const FIRST_BANDS: f64 = 2.0;

/// The learning rate at the end, as a fraction of the largest learning rate. At 0.01 and 0.1:
/// distance 1.01 and 1.20.
const FINAL_RATE: f64 = 0.03;

/// The progress up to which the learning rate rises. At 0.003 and 0.05: distance 1.06 and 1.09.
const WARM_UP: f64 = 0.01;

/// The level of a pyramid of `levels` levels: the coarsest at the start, 0 at the end.
pub fn pyramid_level(progress: f64, levels: usize) -> usize {
    let remaining = FINER_FROM.iter().filter(|from| progress < **from).count();
    remaining.min(levels - 1)
}

/// The learning rate as a fraction of the largest: a short rise, then half a period of a cosine.
pub fn learning_rate(progress: f64) -> f64 {
    Schedule::WarmUpCosine { warm_up: WARM_UP, last: FINAL_RATE }.fraction(progress)
}

/// The shares of the sharp part between which the learning rate of the field's network falls.
const NETWORK_FALL: [f64; 2] = [0.0, 0.5];

/// The shares of the sharp part between which the weight of the bending term falls. Carving has
/// ended by then.
const BENDING_FALL: [f64; 2] = [CARVING[1], 0.6];

/// The shares of the sharp part between which the weight of the term of patches falls.
const PATCHES_FALL: [f64; 2] = [0.0, 0.6];

/// They fall to this factor in long fits.
const LAST: f64 = 0.05;

/// Fits of this many iterations and less have no fall: their network still finds the shape.
const NO_FALL: f64 = 400.0;

/// 1 up to the first share of the sharp part, then a fall by the same factor in equal steps of the
/// progress, up to the second share.
fn fall([from, to]: [f64; 2], progress: f64, soft: f64, iterations: u64) -> f64 {
    let last = (NO_FALL / iterations.max(1) as f64).clamp(LAST, 1.0);
    last.powf(((sharp_share(progress, soft) - from) / (to - from)).clamp(0.0, 1.0))
}

/// The factor on the learning rate of the network of a field with splines near the surface: 1 until
/// the surface is sharp at full size, and less in the sharp part.
///
/// The splines carry the details in the sharp part. A step of the network moves all of the surface,
/// and steps along noise hid details. With 0.1 throughout the sharp part, plain surfaces moved too
/// little. docs/detail.md has both.
pub fn network_rate(progress: f64, soft: f64, iterations: u64) -> f64 {
    fall(NETWORK_FALL, progress, soft, iterations)
}

/// The weight of the bending term as a fraction of the first, for a field with splines near the
/// surface.
///
/// The term keeps surfaces even while they are found, and moves them outwards by a small part of
/// the radius. At the end steps are too short for dents, and photographs pull the surface back.
pub fn bending_weight(progress: f64, soft: f64, iterations: u64) -> f64 {
    fall(BENDING_FALL, progress, soft, iterations)
}

/// The factor on the weight of the term of patches where radiance explains the photographs.
///
/// Patches find the surface. At the end, single pixels know better: docs/captures-compared.md has
/// fits with and without the fall.
pub fn patch_fall(progress: f64, soft: f64, iterations: u64) -> f64 {
    fall(PATCHES_FALL, progress, soft, iterations)
}

/// The weights of `bands` octaves. Each grows from 0 to 1 over half a period of a cosine, coarse
/// octaves first.
///
/// The window of Park, Sinha, Barron, Bouaziz, Goldman, Seitz and Martin-Brualla, "Nerfies:
/// Deformable Neural Radiance Fields", ICCV 2021.
pub fn band_window(progress: f64, bands: usize) -> Vec<f32> {
    let on = FIRST_BANDS + (bands as f64 - FIRST_BANDS).max(0.0) * (progress / BANDS_ON).min(1.0);
    (0..bands)
        .map(|b| {
            let part = (on - b as f64).clamp(0.0, 1.0);
            (0.5 * (1.0 - (std::f64::consts::PI * part).cos())) as f32
        })
        .collect()
}

/// The sharpness of the surface at the start and at the end of the soft part, per bounding radius.
/// From 48 on, the ring of a stool did not appear.
const SHARPNESS: [f64; 2] = [16.0, 200.0];

/// The sharpness of the surface, per bounding radius, if it is soft for a share `soft` of the
/// budget; `None` once it is sharp.
pub fn sharpness(progress: f64, soft: f64) -> Option<f32> {
    let [from, to] = SHARPNESS;
    (progress < soft).then(|| (from * (to / from).powf(progress / soft)) as f32)
}

/// The share of the batch that is drawn while the surface is soft: a soft ray has 25 points, so an
/// iteration would take longer than one with a sharp surface.
///
/// With all of the batch, the Chamfer distance on `bob`, `spot`, the stool and the demo is 0.23,
/// 0.30, 1.0 and 0.7 % of the radius after 4,000 iterations; with this share, 0.24, 0.29, 0.8 and
/// 0.8 % (seed 1).
const SOFT_BATCH: f64 = 0.6;

/// The share of the batch that is drawn, if the surface is soft for a share `soft` of the budget.
pub fn batch_share(progress: f64, soft: f64) -> f64 {
    if progress < soft { SOFT_BATCH } else { 1.0 }
}

/// The share of the budget after the soft part over which the weight of the view direction in the
/// radiance rises from 0 to 1.
const DIRECTION_RISE: f64 = 0.1;

/// The weight of the view direction in the radiance, for a surface that is soft for a share `soft`
/// of the budget; 1 if it is never soft.
///
/// Radiance that depends on the direction could paint the background, as each camera sees it, on a
/// soft sheet in front of the object.
pub fn direction_weight(progress: f64, soft: f64) -> f32 {
    if soft > 0.0 { ((progress - soft) / DIRECTION_RISE).clamp(0.0, 1.0) as f32 } else { 1.0 }
}

/// Carving begins at this part of the soft share of the budget: the colours are known by then. It
/// ends after this part of the sharp share: the shape recovers after that.
const CARVING: [f64; 2] = [0.4, 0.3];

/// Whether surfaces that photographs contradict go back.
pub fn is_carving(progress: f64, soft: f64) -> bool {
    progress >= CARVING[0] * soft && !ends_depths(progress, soft)
}

/// Whether depths are not used any more.
pub fn ends_depths(progress: f64, soft: f64) -> bool {
    progress >= soft + CARVING[1] * (1.0 - soft)
}

/// The parameters of the result are a mean over the budget from here on: the learning rate is small
/// then, so the shape moves little.
const AVERAGED_FROM: f64 = 0.85;

/// Whether the parameters after a step count for the result.
pub fn is_averaged(progress: f64) -> bool {
    progress >= AVERAGED_FROM
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_have_the_expected_values_at_start_and_end() {
        assert_eq!(
            (pyramid_level(0.0, 4), pyramid_level(0.3, 4), pyramid_level(1.0, 4)),
            (3, 0, 0)
        );
        assert_eq!((pyramid_level(0.0, 1), pyramid_level(0.1, 4)), (0, 2));
        assert!(learning_rate(0.0) < 1e-9 && (learning_rate(1.0) - FINAL_RATE).abs() < 1e-9);
        assert_eq!(band_window(0.0, 4), vec![1.0, 1.0, 0.0, 0.0]);
        assert_eq!(band_window(BANDS_ON, 4), vec![1.0; 4]);
        assert_eq!(band_window(0.0, 1), vec![1.0]);
        assert!(band_window(0.7, 0).is_empty());
        assert!(band_window(0.2, 4)[3] < 1.0);
        assert_eq!((sharpness(0.0, 0.5), sharpness(0.5, 0.5)), (Some(16.0), None));
        assert_eq!((sharpness(0.0, 0.0), direction_weight(0.0, 0.0)), (None, 1.0));
        assert_eq!((direction_weight(0.5, 0.5), direction_weight(0.7, 0.5)), (0.0, 1.0));
        assert_eq!((surveys(0.49, 0.5), surveys(0.5, 0.5), surveys(1.0, 0.5)), (0, 1, 3));
        assert_eq!((surveys(0.2, 0.0), surveys(0.3, 0.0)), (0, 1));
        let rate = |progress, soft| network_rate(progress, soft, 10_000);
        assert_eq!((rate(0.2, 0.0), rate(0.5, 0.5)), (1.0, 1.0));
        assert!((rate(0.625, 0.5) - LAST.sqrt()).abs() < 1e-12);
        assert_eq!((rate(0.75, 0.5), rate(0.625, 0.0)), (LAST, LAST));
        let weight = |progress, soft| bending_weight(progress, soft, 10_000);
        assert_eq!((weight(0.6, 0.5), weight(0.9, 0.9)), (1.0, 1.0));
        assert!((weight(0.725, 0.5) - LAST.sqrt()).abs() < 1e-12);
        assert_eq!((weight(0.85, 0.5), weight(1.0, 0.9)), (LAST, LAST));
        assert_eq!((patch_fall(0.5, 0.5, 10_000), patch_fall(0.8, 0.5, 10_000)), (1.0, LAST));
        assert_eq!((network_rate(1.0, 0.5, 400), bending_weight(1.0, 0.5, 0)), (1.0, 1.0));
        assert_eq!(network_rate(1.0, 0.5, 2000), 0.2);
        assert_eq!((batch_share(0.2, 0.5), batch_share(0.5, 0.5)), (SOFT_BATCH, 1.0));
    }
}
