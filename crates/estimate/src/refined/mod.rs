//! The default estimator: silhouettes found along random lines of the film, and integrated there.

mod crossings;
mod neighbours;
mod probes;
mod search;
mod survey;
mod visibility;

use field::Real;
use random::Purpose;
use render::{InvalidField, Pixel, Scene};

use crate::estimator::{Batch, Estimator, SilhouetteMask, Terms};
use crate::film_line::{Crossing, FilmLine};
use crate::record::Record;
use crate::smooth_part::{Stratification, add_smooth_part};
use crossings::{Crossings, crossings};
use survey::{mark_corners, sample_unmarked};

/// Area samples for smooth pixels, and random lines of the film for silhouettes.
///
/// The silhouettes inside a pixel add ∮ ΔL v dl to its derivative, with their normal velocity
/// v = −∂_θ f/|∇_u m| (m = min_t f, by the envelope theorem) and the contrast ΔL. With
/// n = ∇_u m/|∇_u m| and 1 = n_x² + n_y² this is the sum of two integrals over crossings with lines
/// along the axes, ∫ dy Σ ΔL v |n_x| + ∫ dx Σ ΔL v |n_y|. No factor grows where a silhouette runs
/// along a line, and nothing depends on a number N of points along a ray.
///
/// It is the limit of a warp field that falls off ever faster away from silhouettes, sampled on the
/// silhouettes.
#[derive(Clone, Copy, Debug)]
pub struct Refined;

/// The first 1/SCOUTS of a pixel's samples look whether a silhouette may cross it; if so, the others
/// are not taken.
const SCOUTS: u32 = 4;

/// Samples per pixel of a line for the smooth part.
const SEGMENT_SAMPLES: u32 = 2;

impl<R: Real> Estimator<R> for Refined {
    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        mask: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let scene = &scene.clipped_to_solid();
        let spp = batch.counts.spp;
        let mut record = Record::black(batch.pixels.len());
        let unknown = mask.may_cross.is_empty();
        mask.may_cross.resize(batch.pixels.len(), false);
        let mut sampled = 0;
        if unknown {
            sampled = spp.div_ceil(SCOUTS);
            let not_far = sample_unmarked(scene, batch, 0..sampled, &mut record, mask)?;
            mark_corners(scene, batch, &not_far, &mut record, mask)?;
        }
        if spp > sampled {
            sample_unmarked(scene, batch, sampled..spp, &mut record, mask)?;
        }
        if batch.terms == Terms::Silhouettes {
            record.area.clear();
        }
        keep_smooth_pixels(&mut record, mask, spp);
        add_silhouettes(scene, batch, mask, &mut record)?;
        Ok(record)
    }
}

/// Keeps the area samples of unmarked pixels, and adds their radiance.
fn keep_smooth_pixels<R: Real>(record: &mut Record<R>, mask: &SilhouetteMask, spp: u32) {
    record.area.iter_mut().for_each(|area| area.retain(|pixel| !mask.may_cross[pixel as usize]));
    let weight = R::one() / R::of(f64::from(spp));
    for area in &record.area {
        for (sample, share) in area.primary.samples.iter().zip(&area.shares) {
            record.radiance[share.pixel as usize] += sample.radiance * weight;
        }
    }
}

/// Lines with a number in [0, 1) each, which places the line's probe and its samples.
struct RandomLines {
    lines: Vec<FilmLine>,
    offset: Vec<f64>,
}

impl RandomLines {
    /// `count` lines along each axis of the marked pixels.
    fn of(batch: &Batch<'_>, mask: &SilhouetteMask) -> Self {
        let mut out = RandomLines { lines: Vec::new(), offset: Vec::new() };
        for (index, pixel) in batch.pixels.iter().enumerate().filter(|(i, _)| mask.may_cross[*i]) {
            for axis in 0..2 {
                out.add(index as u32, pixel, axis, batch);
            }
        }
        out
    }

    fn add(&mut self, index: u32, pixel: &Pixel, axis: usize, batch: &Batch<'_>) {
        let count = batch.counts.edge_samples;
        let stream = pixel.stream(batch.seed, Purpose::Lines).at(axis as u64);
        for i in 0..count {
            let [across, offset] = stream.sobol(i);
            let mut start = pixel.corner();
            start[1 - axis] += across;
            let share = 1.0 / f64::from(count);
            self.lines.push(FilmLine { pixel: index, camera: pixel.camera, axis, start, share });
            self.offset.push(offset);
        }
    }
}

/// Adds the marked pixels: silhouettes where lines cross them, and the smooth part between.
fn add_silhouettes<R: Real>(
    scene: &Scene<'_, R>,
    batch: &Batch<'_>,
    mask: &SilhouetteMask,
    record: &mut Record<R>,
) -> Result<(), InvalidField> {
    let RandomLines { lines, offset } = RandomLines::of(batch, mask);
    let Crossings { mut crossings, rays } = crossings(scene, &lines, &offset)?;
    record.rays += rays;
    crossings.iter().for_each(|crossing| add_crossing(&lines[crossing.line], crossing, record));
    if batch.terms == Terms::Silhouettes {
        return Ok(());
    }
    crossings.sort_by(|a, b| a.line.cmp(&b.line).then(a.s.total_cmp(&b.s)));
    let stratification = Stratification { offset: &offset, per_pixel: SEGMENT_SAMPLES };
    add_smooth_part(scene, &lines, stratification, &crossings, record)
}

/// Adds ΔL |n_axis|/|∇_u m| at the points of a crossing.
fn add_crossing<R: Real>(line: &FilmLine, crossing: &Crossing<R>, record: &mut Record<R>) {
    let [x, y] = crossing.film_gradient;
    let square = (x * x + y * y).max(R::min_positive_value());
    let share = R::of(line.share);
    let rgb = crossing.contrast * (crossing.film_gradient[line.axis].abs() / square * share);
    for (point, weight) in crossing.points.into_iter().zip(crossing.weights) {
        record.silhouettes.push(line.pixel, point, rgb * weight);
    }
}
