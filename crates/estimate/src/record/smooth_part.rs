//! The smooth part of pixels that a silhouette may cross, sampled along lines on the film.

use field::{Real, Vector3};
use render::{InvalidField, Sample, Scene};

use crate::record::{Area, FilmLine, PixelWeight, Record, SegmentEnd};

/// The stratification of samples along lines.
#[derive(Clone, Copy, Debug)]
pub struct Stratification<'a> {
    /// One number in [0, 1) per line: the position of its samples in their strata.
    pub offset: &'a [f64],
    /// Samples per pixel of length. Every segment has at least one sample.
    pub per_pixel: u32,
}

/// Film samples on the segments of lines.
#[derive(Default)]
struct SegmentSamples<R> {
    samples: Vec<Sample>,
    weights: Vec<PixelWeight<R>>,
    /// The axis of each sample's line.
    axis: Vec<usize>,
}

/// Adds stratified samples of the segments of lines to the record. Segments end at silhouettes, and
/// at creases if the estimator finds them.
///
/// At the distance s inside a silhouette the derivative of the hit point grows as 1/√s, and the
/// mean of its square is infinite. The density of the samples also grows as 1/√s, so the product of
/// weight and derivative is bounded.
///
/// The weight of a sample has the factor n_axis²: the squared component, along its line, of the
/// projected unit normal. Lines along a silhouette do not cross it, and have little weight there.
/// The two axes together have the weight 1, since n_x² + n_y² = 1.
///
/// `ends` are sorted by line, and along each line by s.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn add_smooth_part<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    stratification: Stratification<'_>,
    ends: &[SegmentEnd],
    record: &mut Record<R>,
) -> Result<(), InvalidField> {
    let SegmentSamples { samples, mut weights, axis } =
        segment_samples::<R>(lines, stratification, ends);
    let primary = scene.within_reach(0.0).primary(&samples)?;
    record.rays += samples.len() as u64;
    for (in_pixel, sample) in weights.iter_mut().zip(&primary.samples) {
        // The lines along each of the two axes sample the whole pixel: each has half of the weight.
        in_pixel.weight *= R::of(0.5);
        record.radiance[in_pixel.pixel as usize] += sample.radiance * in_pixel.weight;
    }
    for (hit, normal) in primary.hits.iter().zip(&primary.surface.normal) {
        let i = hit.sample;
        let (_, du) = scene.cameras[samples[i].camera].direction_du(samples[i].u);
        let slope = du.map(|du| normal.dot(R::Vec3::of(du)));
        let square = slope[0] * slope[0] + slope[1] * slope[1];
        if square > R::zero() {
            weights[i].weight *= slope[axis[i]] * slope[axis[i]] / square * R::of(2.0);
        }
    }
    record.area.push(Area::new(primary, weights));
    Ok(())
}

/// Samples of all segments; each has the weight of its part of the pixel, for one axis.
fn segment_samples<R: Real>(
    lines: &[FilmLine],
    Stratification { offset, per_pixel }: Stratification<'_>,
    ends: &[SegmentEnd],
) -> SegmentSamples<R> {
    let mut out = SegmentSamples { samples: Vec::new(), weights: Vec::new(), axis: Vec::new() };
    let mut next = ends.iter().peekable();
    for (i, line) in lines.iter().enumerate() {
        let mut segment = |from: f64, to: f64, dense: [bool; 2]| {
            let count = ((to - from) * f64::from(per_pixel)).ceil().max(1.0);
            for j in 0..count as u32 {
                let (s, sparsity) = placed((f64::from(j) + offset[i]) / count, dense);
                let weight = R::of((to - from) * sparsity / count * line.weight);
                out.samples.push(line.at(from + (to - from) * s));
                out.weights.push(PixelWeight { pixel: line.pixel, weight });
                out.axis.push(line.axis);
            }
        };
        let (mut from, mut dense) = (0.0, false);
        while let Some(end) = next.next_if(|end| end.line == i) {
            segment(from, end.s, [dense, end.steep[0]]);
            (from, dense) = (end.s, end.steep[1]);
        }
        segment(from, 1.0, [dense, false]);
    }
    out
}

/// For a number w that is uniform in [0, 1): the position of a sample in a segment of length 1, and
/// the reciprocal of the density of samples there. At the flagged ends the density grows as
/// 1/√distance.
fn placed(w: f64, dense: [bool; 2]) -> (f64, f64) {
    match dense {
        [false, false] => (w, 1.0),
        [true, false] => (w * w, 2.0 * w),
        [false, true] => (1.0 - (1.0 - w) * (1.0 - w), 2.0 * (1.0 - w)),
        [true, true] => (w * w * (3.0 - 2.0 * w), 6.0 * w * (1.0 - w)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn weighted_samples_integrate_the_cosine_for_all_densities() {
        for dense in [[false, false], [true, false], [false, true], [true, true]] {
            let n = 1000;
            let each = (0..n).map(|i| placed((f64::from(i) + 0.5) / f64::from(n), dense));
            let sum: f64 = each.map(|(s, sparsity)| sparsity * s.cos()).sum();
            assert_relative_eq!(sum / f64::from(n), 1f64.sin(), epsilon = 1e-5);
        }
    }
}
