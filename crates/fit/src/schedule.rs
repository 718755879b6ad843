//! The schedule of a fit: functions of the progress, the fraction of the budget that is spent.

use optim::Schedule;

use crate::options::FitOptions;
use crate::step::Weights;

/// Progress at which each finer level of the pyramid starts, finest last.
const LEVEL_ENDS: [f64; 3] = [0.08, 0.22, 0.45];

/// From the finest level on, one draw stands for a group of this many pixels of certain background:
/// by then their rays miss, and have no gradient. On coarser levels they carve the object.
const BACKGROUND_GROUP: usize = 8;

/// The number of background pixels that one draw stands for.
pub(crate) fn background_group(progress: f64) -> usize {
    if progress < LEVEL_ENDS[2] { 1 } else { BACKGROUND_GROUP }
}

/// Progress from which all octaves of the encoding are on.
const BANDS_ON: f64 = 0.5;

/// Octaves that are on from the start.
const FIRST_BANDS: f64 = 2.0;

/// The learning rate at the end, as a fraction of the largest.
const FINAL_RATE: f64 = 0.03;

/// Progress up to which the learning rate rises.
const WARM_UP: f64 = 0.01;

/// The level of a pyramid of `levels` levels: the coarsest at first, 0 at the end.
pub(crate) fn level(progress: f64, levels: usize) -> usize {
    let remaining = LEVEL_ENDS.iter().filter(|end| progress < **end).count();
    remaining.min(levels - 1)
}

/// The learning rate as a fraction of the largest: a short rise, then half a cosine down.
pub(crate) fn learning_rate(progress: f64) -> f64 {
    Schedule::WarmUpCosine { warm_up: WARM_UP, last: FINAL_RATE }.fraction(progress)
}

/// The weights of `bands` octaves: each fades in with half a cosine, coarse octaves first.
pub(crate) fn band_window(progress: f64, bands: usize) -> Vec<f32> {
    let on = FIRST_BANDS + (bands as f64 - FIRST_BANDS).max(0.0) * (progress / BANDS_ON).min(1.0);
    (0..bands)
        .map(|b| {
            let part = (on - b as f64).clamp(0.0, 1.0);
            (0.5 * (1.0 - (std::f64::consts::PI * part).cos())) as f32
        })
        .collect()
}

/// Progress up to which the estimated background is fully trusted, and from which on hardly any
/// more. The estimate finds the object; the photographs decide the position of its outline.
const TRUST: [f64; 2] = [0.3, 0.7];

/// The trust that is left at the end: it keeps empty space empty.
const LAST_TRUST: f64 = 0.05;

/// The weights of the loss's terms, for a background that is known with `confidence`.
pub(crate) fn weights(progress: f64, options: &FitOptions, confidence: f64) -> Weights {
    let fade = ((TRUST[1] - progress) / (TRUST[1] - TRUST[0])).clamp(LAST_TRUST, 1.0);
    let trust = if options.use_masks { 1.0 } else { confidence * fade };
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
    fn schedules_end_where_they_should() {
        assert_eq!((level(0.0, 4), level(0.3, 4), level(1.0, 4)), (3, 1, 0));
        assert_eq!(level(0.0, 1), 0);
        assert!(learning_rate(0.0) < 1e-9 && (learning_rate(1.0) - FINAL_RATE).abs() < 1e-9);
        assert_eq!(band_window(0.0, 4), vec![1.0, 1.0, 0.0, 0.0]);
        assert_eq!(band_window(1.0, 4), vec![1.0; 4]);
        assert_eq!(band_window(0.0, 1), vec![1.0]);
        assert!(band_window(0.7, 0).is_empty());
    }
}
