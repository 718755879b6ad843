//! The estimator that is the default: silhouettes integrated where they are.

use std::ops::Range;

use field::{Real, Vector3};
use glam::DVec2;
use rustc_hash::FxHashMap;
use trace::{Intersection, Outcome};

use super::lines::{Crossing, Line, crossings};
use super::near::{Doubt, Passage, near_silhouettes, passages};
use super::pixels::{check_valid, first_invalid, pixel_samples};
use super::{Area, Estimator, Pixel, Record, Sample, Setup, Survey};
use crate::InvalidField;
use random::{mix, sobol};

/// Area samples for what is smooth, and random lines of the film for silhouettes.
///
/// The part of a pixel's derivative that comes from silhouettes is ∮ ΔL v dl over those inside the
/// pixel, v their normal velocity −∂_θ f/|∇_u m| (m = min_t f, by the envelope theorem) and ΔL the
/// contrast. With n = ∇_u m/|∇_u m| and 1 = n_x² + n_y² it is the sum of two integrals over
/// crossings with lines along the axes, ∫ dy Σ ΔL v |n_x| + ∫ dx Σ ΔL v |n_y|: no factor grows
/// where a silhouette runs along a line. Nothing depends on a number N of points along a ray.
///
/// It is what a warp field tends to that falls off ever faster away from silhouettes, with samples
/// on the silhouettes.
#[derive(Clone, Copy, Debug)]
pub struct Refined {
    /// Area samples a pixel.
    pub spp: u32,
    /// Lines along each axis of a pixel that a silhouette may cross.
    pub lines: u32,
}

/// One in so many of a pixel's samples looks whether a silhouette may cross it. The others are
/// spared if so.
const SCOUTS: u32 = 4;

/// A corner's ray that passes a surface by less than this, in pixels, makes its pixels suspect: no
/// place in a pixel is further from all corners.
const CORNER_REACH: f64 = 0.75;

/// A ray that clears all surfaces by more than this, in pixels, answers for its whole pixel; √2
/// would do if f were a distance.
const FAR: f64 = 3.2;

/// Samples of the smooth part on a line; at least one between two silhouettes.
const SEGMENT_RAYS: u32 = 2;

/// The lines of a pixel, with a uniform number each, which places its probe and its samples.
fn pixel_lines(
    index: u32,
    pixel: &Pixel,
    count: u32,
    seed: u64,
    lines: &mut Vec<Line>,
    along: &mut Vec<f64>,
) {
    for axis in 0..2 {
        let stream =
            mix(mix(seed, 0x11e5 + axis as u64), u64::from(pixel.y) << 32 | u64::from(pixel.x));
        for i in 0..count {
            let [across, place] = sobol(i, stream);
            let mut start = DVec2::new(f64::from(pixel.x), f64::from(pixel.y));
            start[1 - axis] += across;
            lines.push(Line {
                pixel: index,
                camera: pixel.camera,
                axis,
                start,
                share: 1.0 / f64::from(count),
            });
            along.push(place);
        }
    }
}

impl<R: Real> Estimator<R> for Refined {
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
    ) -> Result<Record<R>, InvalidField> {
        self.record_surveyed(setup, pixels, seed, &mut Survey::default())
    }

    fn record_surveyed(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
        survey: &mut Survey,
    ) -> Result<Record<R>, InvalidField> {
        let setup = &setup.hugged();
        let mut record =
            Record { radiance: vec![R::Vec3::zero(); pixels.len()], ..Record::default() };
        let first = survey.near.is_empty();
        survey.near.resize(pixels.len(), false);
        let mut sampled = 0;
        if first {
            sampled = self.spp.div_ceil(SCOUTS);
            let left = self.scout(setup, pixels, 0..sampled, seed, &mut record, survey)?;
            corners(setup, pixels, &left, &mut record, survey)?;
        }
        if self.spp > sampled {
            self.scout(setup, pixels, sampled..self.spp, seed, &mut record, survey)?;
        }
        let near: Vec<u32> =
            (0..pixels.len()).filter(|&i| survey.near[i]).map(|i| i as u32).collect();
        if !setup.smooth {
            record.area.clear();
        }
        record.area.iter_mut().for_each(|area| area.retain(|pixel| !survey.near[pixel as usize]));
        let share = R::one() / R::of(f64::from(self.spp));
        for area in &record.area {
            for (radiance, &pixel) in area.primary.radiance.iter().zip(&area.pixel) {
                record.radiance[pixel as usize] += *radiance * share;
            }
        }
        self.silhouettes(setup, pixels, &near, seed, &mut record)?;
        Ok(record)
    }
}

impl Refined {
    /// Samples pixels that no silhouette is known near, and finds some more of these. Returns the
    /// pixels left whose rays are not far from all surfaces.
    fn scout<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        range: Range<u32>,
        seed: u64,
        record: &mut Record<R>,
        survey: &mut Survey,
    ) -> Result<Vec<u32>, InvalidField> {
        let which: Vec<u32> =
            (0..pixels.len() as u32).filter(|&i| !survey.near[i as usize]).collect();
        let samples = pixel_samples(which.iter().map(|&i| pixels[i as usize]), &range, seed);
        let primary = setup.primary(&samples);
        check_valid(setup, &samples, primary.invalid)?;
        record.rays += samples.len() as u64;
        let near = near_silhouettes(setup, &samples, &primary, Doubt::SMALL);
        let mut hit = vec![false; samples.len()];
        primary.hits.iter().for_each(|&i| hit[i] = true);
        let count = range.len();
        let mixed = |own: &[bool]| own.contains(&true) && own.contains(&false);
        let mut left = Vec::new();
        for (i, &pixel) in which.iter().enumerate() {
            let own = i * count..(i + 1) * count;
            if near[own.clone()].contains(&true) || mixed(&hit[own.clone()]) {
                survey.near[pixel as usize] = true;
            } else if !own.clone().any(|i| is_far(setup, &samples[i], &primary.found[i])) {
                left.push(pixel);
            }
        }
        let n = samples.len();
        record.area.push(Area {
            samples,
            primary,
            pixel: (0..n).map(|i| which[i / count]).collect(),
            weight: vec![R::one() / R::of(f64::from(self.spp)); n],
            warp: None,
        });
        Ok(left)
    }

    /// Pixels that a silhouette may cross: all by lines.
    fn silhouettes<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        near: &[u32],
        seed: u64,
        record: &mut Record<R>,
    ) -> Result<(), InvalidField> {
        let (mut lines, mut along) = (Vec::new(), Vec::new());
        for &i in near {
            pixel_lines(i, &pixels[i as usize], self.lines, seed, &mut lines, &mut along);
        }
        let (mut crossings, rays) = crossings(setup, &lines, &along)?;
        record.rays += rays;
        for crossing in &crossings {
            let line = &lines[crossing.line];
            let share = R::of(line.share);
            let [x, y] = crossing.rise;
            let square = (x * x + y * y).max(R::min_positive_value());
            let rgb = crossing.contrast * (crossing.rise[line.axis].abs() / square * share);
            for (point, weight) in crossing.points.into_iter().zip(crossing.weights) {
                record.silhouettes.push(line.pixel, point, rgb * weight);
            }
        }
        if !setup.smooth {
            return Ok(());
        }
        crossings.sort_by(|a, b| a.line.cmp(&b.line).then(a.s.total_cmp(&b.s)));
        between(setup, &lines, (&along, SEGMENT_RAYS), &crossings, record)
    }
}

/// The smooth part of pixels that a silhouette may cross: stratified samples of the lines' visible
/// segments.
///
/// Inside a silhouette at distance s the derivative of the hit grows as 1/√s, and its square has no
/// mean. Samples that are dense as 1/√s there have bounded weights times it. As for silhouettes
/// themselves, a line counts by the square of the normal's component along it, so that lines that
/// run along a silhouette, which no crossing tells of, do not matter. A line has a uniform number
/// that places its samples, and a number of samples per pixel.
pub(super) fn between<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    (along, rays): (&[f64], u32),
    crossings: &[Crossing<R>],
    record: &mut Record<R>,
) -> Result<(), InvalidField> {
    let (mut samples, mut pixel, mut axis, mut weight) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut next = crossings.iter().peekable();
    for (i, line) in lines.iter().enumerate() {
        let (mut from, mut dense) = (0.0, false);
        let mut segment = |from: f64, to: f64, dense: [bool; 2]| {
            let count = ((to - from) * f64::from(rays)).ceil().max(1.0);
            for j in 0..count as u32 {
                let (s, rate) = placed((f64::from(j) + along[i]) / count, dense);
                samples.push(line.at(from + (to - from) * s));
                pixel.push(line.pixel);
                axis.push(line.axis);
                weight.push(R::of((to - from) * rate / count * line.share));
            }
        };
        while let Some(crossing) = next.next_if(|c| c.line == i) {
            segment(from, crossing.s, [dense, crossing.leaves]);
            (from, dense) = (crossing.s, !crossing.leaves);
        }
        segment(from, 1.0, [dense, false]);
    }
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    record.rays += samples.len() as u64;
    for i in 0..samples.len() {
        weight[i] *= R::of(0.5);
        record.radiance[pixel[i] as usize] += primary.radiance[i] * weight[i];
    }
    for (hit, &i) in primary.hits.iter().enumerate() {
        let (_, du) = setup.cameras[samples[i].camera].direction_du(samples[i].u);
        let rise = du.map(|du| primary.normal[hit].dot(R::Vec3::of(du)));
        let square = rise[0] * rise[0] + rise[1] * rise[1];
        if square > R::zero() {
            weight[i] *= rise[axis[i]] * rise[axis[i]] / square * R::of(2.0);
        }
    }
    record.area.push(Area { samples, primary, pixel, weight, warp: None });
    Ok(())
}

/// Whether a ray passes everything by so far that no silhouette can be in its pixel, if f is no
/// distance but not far from one.
fn is_far<R: Real>(setup: &Setup<'_, R>, sample: &Sample, found: &Option<Intersection<R>>) -> bool {
    let far = R::of(setup.cameras[sample.camera].pixel_angle() * FAR);
    match found {
        Some(found) => {
            found.outcome == Outcome::Miss && found.clearance > far && found.clearance.is_finite()
        }
        None => setup.beside(sample).1 > far,
    }
}

/// Finds the pixels among `which` at whose corners different things are seen, or a surface is
/// passed closely: a silhouette without curvature (an edge of a solid) that cuts a corner shows in
/// no other ray of the pixel.
fn corners<R: Real>(
    setup: &Setup<'_, R>,
    pixels: &[Pixel],
    which: &[u32],
    record: &mut Record<R>,
    survey: &mut Survey,
) -> Result<(), InvalidField> {
    let mut known = FxHashMap::default();
    let mut samples = Vec::new();
    let mut corner = |camera: usize, x: u32, y: u32| {
        *known.entry((camera, x, y)).or_insert_with(|| {
            samples.push(Sample { camera, u: DVec2::new(f64::from(x), f64::from(y)) });
            samples.len() - 1
        })
    };
    let of_pixel: Vec<[usize; 4]> = which
        .iter()
        .map(|&i| {
            let Pixel { camera, x, y } = pixels[i as usize];
            [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| corner(camera, x, y))
        })
        .collect();
    let (rays, found) = setup.find(&samples);
    check_valid(setup, &samples, first_invalid(&found))?;
    record.rays += samples.len() as u64;
    let hits = |i: usize| found[i].is_some_and(|f| f.outcome == Outcome::Hit);
    let mut passed: Vec<Option<Passage>> = (0..samples.len()).map(|_| None).collect();
    for passage in passages(setup, &samples, &rays, &found, CORNER_REACH) {
        let sample = passage.sample;
        passed[sample] = Some(passage);
    }
    for (&pixel, four) in which.iter().zip(&of_pixel) {
        let Pixel { x, y, .. } = pixels[pixel as usize];
        let least = DVec2::new(f64::from(x), f64::from(y));
        let close = |i: usize| {
            passed[i].as_ref().is_some_and(|p| p.crosses(samples[i].u, least, Doubt::SMALL))
        };
        survey.near[pixel as usize] = four.iter().any(|&i| hits(i) != hits(four[0]) || close(i));
    }
    Ok(())
}

/// Where in a segment of length 1 the sample with the uniform number w lies, and how sparse samples
/// are there; denser towards the ends for which it is asked.
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
    fn placed_samples_integrate() {
        for dense in [[false, false], [true, false], [false, true], [true, true]] {
            let n = 1000;
            let each = (0..n).map(|i| placed((f64::from(i) + 0.5) / f64::from(n), dense));
            let sum: f64 = each.map(|(s, rate)| rate * s.cos()).sum();
            assert_relative_eq!(sum / f64::from(n), 1f64.sin(), epsilon = 1e-5);
        }
    }
}
