//! Crossings of chords with silhouettes, by bisection.

use estimate::record::Record;
use estimate::{Batch, SilhouetteMask};
use field::{Real, Vector3};
use glam::DVec2;
use render::{InvalidField, Sample, Scene};

use crate::chord::chords;

/// The number of intervals of a chord. Two silhouettes inside one interval may be missed.
const PARTS: u32 = 4;

/// Halvings of an interval: the error of a crossing is then 1e-6 pixels or less.
const HALVINGS: u32 = 20;

/// The least jump in depth, in [`Scene::tracing_scale`], that counts as a silhouette after all
/// halvings. The depth of a surface seen edge-on changes by less.
const JUMP: f64 = 3e-3;

/// An interval of a chord; the rays at its ends hit different surfaces.
struct Interval<R> {
    /// The pixel, by its number in the batch.
    pixel: u32,
    camera: usize,
    /// The weight of its chord, in pixels.
    measure: f64,
    ends: [DVec2; 2],
    /// The depths at the ends, in world units; infinite for a ray without a hit.
    depth: [R; 2],
}

impl<R: Real> Interval<R> {
    fn sample(&self, end: usize) -> Sample {
        Sample { camera: self.camera, u: self.ends[end] }
    }

    fn middle(&self) -> Sample {
        Sample { camera: self.camera, u: (self.ends[0] + self.ends[1]) * 0.5 }
    }

    fn jumps(&self, scene: &Scene<'_, R>) -> bool {
        let [a, b] = self.depth;
        a != b && (a - b).abs() > scene.tracing_scale(self.camera, a.min(b)) * R::of(JUMP)
    }

    /// Keeps the half with the larger jump; `t` is the depth at the middle.
    fn halve(&mut self, t: R) {
        let jump = |a: R, b: R| if a == b { R::zero() } else { (a - b).abs() };
        let moved = usize::from(jump(self.depth[0], t) >= jump(t, self.depth[1]));
        (self.ends[moved], self.depth[moved]) = (self.middle().u, t);
    }
}

/// Adds the silhouettes of the marked pixels.
pub(crate) fn add_silhouettes<R: Real>(
    scene: &Scene<'_, R>,
    batch: &Batch<'_>,
    mask: &SilhouetteMask,
    record: &mut Record<R>,
) -> Result<(), InvalidField> {
    let mut open = intervals(scene, batch, mask, record)?;
    for _ in 0..HALVINGS {
        let samples: Vec<Sample> = open.iter().map(Interval::middle).collect();
        for (interval, t) in open.iter_mut().zip(depths(scene, &samples, record)?) {
            interval.halve(t);
        }
        open.retain(|interval| interval.jumps(scene));
    }
    add_crossings(scene, &open, record)
}

/// The intervals of all chords with different surfaces at their ends.
fn intervals<R: Real>(
    scene: &Scene<'_, R>,
    batch: &Batch<'_>,
    mask: &SilhouetteMask,
    record: &mut Record<R>,
) -> Result<Vec<Interval<R>>, InvalidField> {
    let mut all = Vec::new();
    for (number, pixel) in batch.pixels.iter().enumerate().filter(|(i, _)| mask.may_cross[*i]) {
        for chord in chords(pixel, batch.counts.edge_samples, batch.stream) {
            let at = |i: u32| chord.ends[0].lerp(chord.ends[1], f64::from(i) / f64::from(PARTS));
            all.extend((0..PARTS).map(|i| Interval {
                pixel: number as u32,
                camera: pixel.camera,
                measure: chord.measure,
                ends: [at(i), at(i + 1)],
                depth: [R::infinity(); 2],
            }));
        }
    }
    for end in 0..2 {
        let samples: Vec<Sample> = all.iter().map(|interval| interval.sample(end)).collect();
        for (interval, t) in all.iter_mut().zip(depths(scene, &samples, record)?) {
            interval.depth[end] = t;
        }
    }
    all.retain(|interval| interval.jumps(scene));
    Ok(all)
}

/// The depths at film positions, in world units; infinite for a ray without a hit.
fn depths<R: Real>(
    scene: &Scene<'_, R>,
    samples: &[Sample],
    record: &mut Record<R>,
) -> Result<Vec<R>, InvalidField> {
    record.rays += samples.len() as u64;
    let traced = scene.trace(samples)?;
    let depth = |ray: &Option<render::TracedRay<R>>| ray.and_then(|ray| ray.depth());
    Ok(traced.iter().map(|ray| depth(ray).unwrap_or(R::infinity())).collect())
}

/// Adds ΔL/|∇_u m| · measure at the silhouette point of every interval.
///
/// With m(u) = min_t f, the silhouette is {m = 0}, and its normal velocity is −∂_θ f/|∇_u m|. The
/// ray at the far end of the interval passes the silhouette point. Its closest approach, which the
/// tracer has recorded, is used as the silhouette point.
fn add_crossings<R: Real>(
    scene: &Scene<'_, R>,
    open: &[Interval<R>],
    record: &mut Record<R>,
) -> Result<(), InvalidField> {
    let near = |i: &Interval<R>| usize::from(i.depth[1] < i.depth[0]);
    let inside: Vec<Sample> = open.iter().map(|i| i.sample(near(i))).collect();
    let outside: Vec<Sample> = open.iter().map(|i| i.sample(1 - near(i))).collect();
    let (inside, outside) = (scene.primary(&inside)?, scene.primary(&outside)?);
    record.rays += 2 * open.len() as u64;
    let x: Vec<R::Vec3> = open
        .iter()
        .zip(&outside.samples)
        .map(|(interval, sample)| match outside.ray_of(sample) {
            Some(traced) if traced.found.clearance.is_finite() => {
                traced.ray.at(traced.found.nearest)
            }
            // The ray misses the ball of rays, or has no closest approach.
            _ => point_at(scene, &interval.sample(near(interval)), interval.depth[near(interval)]),
        })
        .collect();
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    scene.field.value_gradient(&x, &mut f, &mut gradient);
    for (k, interval) in open.iter().enumerate() {
        let Sample { camera, u } = outside.samples[k].sample;
        let camera = &scene.cameras[camera];
        let (_, du) = camera.direction_du(u);
        let t = (x[k] - R::Vec3::of(camera.eye)).length();
        let slope = du.map(|du| gradient[k].dot(R::Vec3::of(du)) * t);
        let slope = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
        let contrast = inside.samples[k].radiance - outside.samples[k].radiance;
        let weight = R::of(interval.measure) / slope.max(R::min_positive_value());
        record.silhouettes.push(interval.pixel, x[k], contrast * weight);
    }
    Ok(())
}

/// The point at the distance t along the ray of a sample, in world units.
fn point_at<R: Real>(scene: &Scene<'_, R>, sample: &Sample, t: R) -> R::Vec3 {
    let camera = &scene.cameras[sample.camera];
    R::Vec3::of(camera.eye) + R::Vec3::of(camera.direction(sample.u)) * t
}
