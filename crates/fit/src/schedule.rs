//! The schedule of a fit: functions of the progress, the spent fraction of the budget.

use optim::Schedule;

use crate::masks::MaskUse;
use crate::model_background::BackgroundKind;
use crate::options::FitOptions;

// Evidence, here and for the other constants of this crate: one constant changed at a time, 1000
// iterations on the demo's scene and on the stool of the sweeps (24 views of 128 × 128 pixels), two
// seeds each. "Distance" is the geometric mean of the four Chamfer distances, relative to that of
// the values in the code; its standard error is about 0.05. So a value within 0.9 to 1.1 cannot be
// told apart from the chosen one.

/// The progress at which each finer level of the pyramid starts, the finest last. At half and at
/// one and a half times these numbers: distance 1.06 and 1.11.
const LEVEL_ENDS: [f64; 3] = [0.08, 0.22, 0.45];

/// The same before a trained background: the shape must be fine while the surface is soft.
const LEVEL_ENDS_SOFT: [f64; 3] = [0.05, 0.12, 0.25];

/// The progress at which each finer level starts.
fn level_ends(background: BackgroundKind) -> &'static [f64; 3] {
    if background.is_trained() { &LEVEL_ENDS_SOFT } else { &LEVEL_ENDS }
}

/// The share of the budget that is spent on the finest level.
pub(crate) const FINEST_SHARE: f64 = 1.0 - LEVEL_ENDS[2];

/// On the finest level, one draw stands for a group of this many certain background pixels: their
/// rays miss by then, and have no gradient. On coarser levels these pixels carve the object; with
/// groups from the start, the Chamfer distance after 1000 iterations was 1.1 % of the bounding
/// radius instead of 0.9 %. Groups of 4 and 16 on the finest level: distance 0.97 and 0.95.
const BACKGROUND_GROUP: usize = 8;

/// The same on coarser levels before a trained background, which these pixels train alone. With
/// groups of 1, a fit was as good and took longer.
const COARSE_GROUP: usize = 4;

/// The number of background pixels that one draw stands for.
pub(crate) fn background_group(progress: f64, background: BackgroundKind) -> usize {
    match (progress >= level_ends(background)[2], background.is_trained()) {
        (true, _) => BACKGROUND_GROUP,
        (false, true) => COARSE_GROUP,
        (false, false) => 1,
    }
}

/// The progress from which all octaves of the encodings have their full weight. From 0.25 and from
/// 0.8: distance 1.02 and 1.03.
const BANDS_ON: f64 = 0.5;

/// The same before a trained background: the shape must be fine while the surface is soft.
const BANDS_ON_SOFT: f64 = 0.25;

/// The number of octaves with full weight at the start. With 1 and 4: distance 1.03 and 0.97.
const FIRST_BANDS: f64 = 2.0;

/// The learning rate at the end, as a fraction of the largest learning rate. At 0.01 and 0.1:
/// distance 1.01 and 1.20.
const FINAL_RATE: f64 = 0.03;

/// The progress up to which the learning rate rises. At 0.003 and 0.05: distance 1.06 and 1.09.
const WARM_UP: f64 = 0.01;

/// The level of a pyramid of `levels` levels: the coarsest at the start, 0 at the end.
pub(crate) fn level(progress: f64, levels: usize, background: BackgroundKind) -> usize {
    let remaining = level_ends(background).iter().filter(|end| progress < **end).count();
    remaining.min(levels - 1)
}

/// The learning rate as a fraction of the largest: a short rise, then half a period of a cosine.
pub(crate) fn learning_rate(progress: f64) -> f64 {
    Schedule::WarmUpCosine { warm_up: WARM_UP, last: FINAL_RATE }.fraction(progress)
}

/// The weights of `bands` octaves. Each grows from 0 to 1 over half a period of a cosine, coarse
/// octaves first.
///
/// The window of Park, Sinha, Barron, Bouaziz, Goldman, Seitz and Martin-Brualla, "Nerfies:
/// Deformable Neural Radiance Fields", ICCV 2021.
pub(crate) fn band_window(progress: f64, bands: usize, background: BackgroundKind) -> Vec<f32> {
    let end = if background.is_trained() { BANDS_ON_SOFT } else { BANDS_ON };
    let on = FIRST_BANDS + (bands as f64 - FIRST_BANDS).max(0.0) * (progress / end).min(1.0);
    (0..bands)
        .map(|b| {
            let part = (on - b as f64).clamp(0.0, 1.0);
            (0.5 * (1.0 - (std::f64::consts::PI * part).cos())) as f32
        })
        .collect()
}

/// The progress at which the trust in the estimated background starts to fall, and at which it has
/// fallen to [`LAST_TRUST`]. Early, the background separates the object from its surroundings.
/// Later, the photographs decide the position of the outline. From 0.1 to 0.5 and from 0.5 to 0.9:
/// distance 1.04 and 0.99.
const TRUST: [f64; 2] = [0.3, 0.7];

/// The trust at the end, as a fraction: it keeps empty space empty. At 0 and 0.2: distance
/// 1.02 and 1.00.
const LAST_TRUST: f64 = 0.05;

/// The progress at which a soft surface becomes sharp.
const SOFT: f64 = 0.65;

/// The sharpness of the surface at the start and at the end of the soft part, per bounding radius.
const SHARPNESS: [f64; 2] = [48.0, 200.0];

/// The sharpness of the surface, per bounding radius; `None` once it is sharp. Before a uniform
/// background it is sharp from the start.
pub(crate) fn sharpness(progress: f64, background: BackgroundKind) -> Option<f32> {
    let [from, to] = SHARPNESS;
    let soft = background.is_trained() && progress < SOFT;
    soft.then(|| (from * (to / from).powf(progress / SOFT)) as f32)
}

/// The progress over which the weight of the view direction in the radiance rises from 0 to 1.
///
/// Radiance that depends on the direction could paint the background, as each camera sees it, on a
/// soft sheet in front of the object.
const DIRECTION: [f64; 2] = [SOFT, 0.75];

/// The weight of the view direction in the radiance. Before a uniform background it is 1.
pub(crate) fn direction_weight(progress: f64, background: BackgroundKind) -> f32 {
    let [from, to] = DIRECTION;
    let weight = ((progress - from) / (to - from)).clamp(0.0, 1.0);
    if background.is_trained() { weight as f32 } else { 1.0 }
}

/// The weights of the terms of the loss, at one progress of the schedule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weights {
    /// The weight of the eikonal term.
    pub(crate) eikonal: f32,
    /// The weight of the background force.
    pub(crate) background: f32,
    /// The trust in the estimated background, against the photographs, 0 to 1.
    pub(crate) trust: f32,
}

/// The weights of the terms of the loss, for a uniform background of this confidence (0 to 1).
///
/// With the coverage of masks, the trust is 1 for the whole fit.
pub(crate) fn weights(
    progress: f64,
    options: &FitOptions,
    masks: MaskUse,
    confidence: f64,
) -> Weights {
    let fade = ((TRUST[1] - progress) / (TRUST[1] - TRUST[0])).clamp(LAST_TRUST, 1.0);
    let trust = if masks == MaskUse::Coverage { 1.0 } else { confidence * fade };
    Weights {
        eikonal: options.eikonal as f32,
        background: (options.background_weight * trust) as f32,
        trust: trust as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_have_the_expected_values_at_start_and_end() {
        let of = |progress, levels| level(progress, levels, BackgroundKind::Constant);
        assert_eq!((of(0.0, 4), of(0.3, 4), of(1.0, 4)), (3, 1, 0));
        assert_eq!((of(0.0, 1), level(0.3, 4, BackgroundKind::Volume)), (0, 0));
        assert!(learning_rate(0.0) < 1e-9 && (learning_rate(1.0) - FINAL_RATE).abs() < 1e-9);
        let window = |progress, bands| band_window(progress, bands, BackgroundKind::Constant);
        assert_eq!(window(0.0, 4), vec![1.0, 1.0, 0.0, 0.0]);
        assert_eq!(window(1.0, 4), vec![1.0; 4]);
        assert_eq!(window(0.0, 1), vec![1.0]);
        assert!(window(0.7, 0).is_empty());
        assert_eq!(band_window(0.25, 4, BackgroundKind::Volume), vec![1.0; 4]);
        assert!(window(0.25, 4)[3] < 1.0);
    }
}
