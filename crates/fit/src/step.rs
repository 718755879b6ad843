//! One iteration's gradient: photometric, silhouette, eikonal and background terms over a batch of
//! pixels.

use field::Vector3;
use glam::{DVec2, DVec3, Vec3};

use super::loss::{Target, photometric, squared_error};
use super::pyramid::{Backdrop, Level, Pixel};
use estimate::InvalidField;
use estimate::{
    self, Adjoints, Area, Doubt, Estimator, Pass, Primary, Sample, Setup, Survey, check_valid,
    near_silhouettes, ordered_sum,
};
use random::{mix, unit};

/// Pixels a chunk of an iteration, at most; fewer fill the field's blocks less.
const CHUNK: usize = 512;

/// Chunks of an iteration, at least, for two threads to share.
const CHUNKS: usize = 2;

/// The weights of the loss's terms at this point of the schedule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weights {
    /// Eikonal term.
    pub(crate) eikonal: f32,
    /// Background term.
    pub(crate) background: f32,
    /// How far the guess at the background is believed over the photograph, 0 to 1.
    pub(crate) trust: f32,
}

/// What an iteration looks at.
pub(crate) struct Batch<'a> {
    /// Field, shader, cameras of the level, estimator settings.
    pub(crate) setup: Setup<'a, f32>,
    /// The images.
    pub(crate) level: &'a Level,
    /// The pixels.
    pub(crate) pixels: &'a [Pixel],
    /// The number of pixels that so many draws stand for on average. Their own count would favour
    /// what is drawn for itself: a mean of ratios.
    pub(crate) pixel_count: f32,
    /// What tells of the background.
    pub(crate) backdrop: Backdrop,
    /// Weights of the terms.
    pub(crate) weights: Weights,
    /// How pixels are differentiated that a silhouette may cross.
    pub(crate) estimator: &'a dyn Estimator<f32>,
    /// How many silhouettes across the whole pixel one sample's coefficient may be worth.
    pub(crate) limit: f32,
    /// Seed of this iteration.
    pub(crate) seed: u64,
}

/// Sums over a batch.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Pixels that the batch stands for.
    pub(crate) pixels: u64,
    /// Photometric loss.
    pub(crate) photometric: f64,
    /// (|∇f| − 1)².
    pub(crate) eikonal: f64,
    /// Points of the eikonal term.
    pub(crate) eikonal_points: u64,
    /// Squared error in display space.
    pub(crate) squared_error: f64,
    /// Pixels that a silhouette may cross.
    pub(crate) edge_pixels: u64,
    /// Rays traced.
    pub(crate) rays: u64,
}

impl Tally {
    fn add(&mut self, o: &Tally) {
        self.pixels += o.pixels;
        self.photometric += o.photometric;
        self.eikonal += o.eikonal;
        self.eikonal_points += o.eikonal_points;
        self.squared_error += o.squared_error;
        self.edge_pixels += o.edge_pixels;
        self.rays += o.rays;
    }
}

/// The gradient of the batch's mean loss: the field's parameters first, then the radiance head's.
pub(crate) fn gradient(batch: &Batch<'_>) -> Result<(Vec<f32>, Tally), InvalidField> {
    let field = batch.setup.field.parameter_count();
    let length = field + batch.setup.shader.parameter_count();
    let chunks = batch.pixels.len().div_ceil(CHUNK).max(CHUNKS);
    let size = batch.pixels.len().div_ceil(chunks);
    let (sum, tallies) = ordered_sum(chunks, length, |chunk, sum: &mut [f32]| {
        let pixels =
            (chunk * size).min(batch.pixels.len())..((chunk + 1) * size).min(batch.pixels.len());
        let (field_sum, shader_sum) = sum.split_at_mut(field);
        let mut work = Chunk::new(batch, &batch.pixels[pixels], mix(batch.seed, chunk as u64));
        work.run(shader_sum)?;
        work.adjoints.backward(batch.setup.field, field_sum);
        Ok(work.tally)
    })?;
    let mut tally = Tally::default();
    tallies.iter().for_each(|t| tally.add(t));
    Ok((sum, tally))
}

/// The number of pixels that some stand for.
fn count(pixels: &[Pixel]) -> u64 {
    pixels.iter().map(|p| u64::from(p.count)).sum()
}

/// A chunk of a batch at work.
struct Chunk<'a> {
    batch: &'a Batch<'a>,
    pixels: &'a [Pixel],
    seed: u64,
    /// 1 / the number of pixels that the batch stands for.
    share: f32,
    adjoints: Adjoints<f32>,
    tally: Tally,
}

impl<'a> Chunk<'a> {
    fn new(batch: &'a Batch<'a>, pixels: &'a [Pixel], seed: u64) -> Self {
        let share = 1.0 / batch.pixel_count;
        Chunk { batch, pixels, seed, share, adjoints: Adjoints::default(), tally: Tally::default() }
    }

    fn run(&mut self, shader: &mut [f32]) -> Result<(), InvalidField> {
        let samples = self.look();
        let setup = &self.batch.setup;
        let first = setup.primary(&samples);
        check_valid(setup, &samples, first.invalid)?;
        self.tally.rays += samples.len() as u64;
        self.tally.pixels += count(self.pixels);
        let crossed = near_silhouettes(setup, &samples, &first, Doubt::LARGE);
        self.clear_background(&samples, &first);
        self.eikonal(&first);
        self.inside(samples, first, &crossed, shader);
        let edge: Vec<Pixel> =
            (0..self.pixels.len()).filter(|&i| crossed[i]).map(|i| self.pixels[i]).collect();
        self.silhouettes(&edge, shader)
    }

    /// One sample somewhere in every pixel.
    fn look(&self) -> Vec<Sample> {
        let place = |(i, p): (usize, &Pixel)| {
            let [a, b] = [0, 1].map(|d| unit(mix(self.seed, 2 * i as u64 + d)));
            Sample {
                camera: p.view as usize,
                u: DVec2::new(f64::from(p.x) + a, f64::from(p.y) + b),
            }
        };
        self.pixels.iter().enumerate().map(place).collect()
    }

    /// Loss of one pixel's radiance; returns the adjoint of the radiance.
    fn score(&mut self, radiance: [f32; 3], p: Pixel) -> Vec3 {
        let target = Target::of(&self.batch.level.images[p.view as usize], p.x.into(), p.y.into());
        let (loss, adjoint) = photometric(radiance, &target);
        self.tally.photometric += f64::from(loss) * f64::from(p.count);
        self.tally.squared_error +=
            f64::from(squared_error(radiance, target.radiance)) * f64::from(p.count);
        Vec3::from(adjoint) * (self.share * f32::from(p.count))
    }

    /// Pixels without silhouettes: the derivative through the hit point is all there is.
    fn inside(
        &mut self,
        samples: Vec<Sample>,
        first: Primary<f32>,
        crossed: &[bool],
        shader: &mut [f32],
    ) {
        let n = samples.len();
        let mut delta = vec![Vec3::ZERO; n];
        for (i, pixel) in self.pixels.iter().enumerate().filter(|(i, _)| !crossed[*i]) {
            delta[i] = self.score(first.radiance[i].into(), *pixel);
        }
        // A hit that should not be there is not to be painted like the background, but cleared.
        for &i in &first.hits {
            delta[i] *=
                1.0 - self.batch.weights.trust * self.background_probability(self.pixels[i]);
        }
        let area = Area {
            samples,
            primary: first,
            pixel: (0..n as u32).collect(),
            weight: vec![1.0; n],
            warp: None,
        };
        area.vjp(
            &self.batch.setup,
            &delta,
            Pass::Limited(self.batch.limit),
            shader,
            &mut self.adjoints,
        );
    }

    /// The probability that a pixel shows the background.
    fn background_probability(&self, p: Pixel) -> f32 {
        let (level, view) = (&self.batch.level, p.view as usize);
        self.batch.backdrop.probability(
            &level.images[view],
            level.masks[view].as_ref(),
            p.x.into(),
            p.y.into(),
        )
    }

    /// Pushes the surface away where a ray hits although its pixel looks like the background, and
    /// towards a ray that misses although its pixel does not. A constant force on f: a prior, not a
    /// derivative of the image.
    fn clear_background(&mut self, samples: &[Sample], first: &Primary<f32>) {
        let each = self.batch.weights.background * self.share / self.batch.setup.bounds.radius;
        if each == 0.0 {
            return;
        }
        let mut hit = vec![None; samples.len()];
        first.hits.iter().enumerate().for_each(|(h, &i)| hit[i] = Some(h));
        for (i, pixel) in self.pixels.iter().enumerate() {
            let weight = each * f32::from(pixel.count);
            let probability = self.background_probability(*pixel);
            let doubt = if hit[i].is_some() { probability } else { 1.0 - probability };
            if doubt < CERTAIN
                && first.found[i].is_none_or(|found| found.outcome != trace::Outcome::Inside)
            {
                continue;
            }
            if let Some(h) = hit[i] {
                self.adjoints.push(0, first.x[h], -weight * probability, Vec3::ZERO);
            } else if let (Some(ray), Some(found)) = (first.rays[i], first.found[i]) {
                if found.outcome == trace::Outcome::Inside {
                    // The solid has reached the bounding sphere, where nothing is seen any more:
                    // back.
                    self.adjoints.push(0, ray.at(found.t), -weight, Vec3::ZERO);
                    continue;
                }
                let nearest = ray.origin + ray.direction * found.t;
                self.adjoints.push(0, nearest, weight * (1.0 - probability), Vec3::ZERO);
            }
        }
    }

    /// (|∇f| − 1)² near the surface for pixels that hit, and anywhere in the ball, at
    /// [`EIKONAL_EVERY`] of the points that it is weighted for: one a hit, one half a pixel.
    fn eikonal(&mut self, first: &Primary<f32>) {
        let bounds = &self.batch.setup.bounds;
        let every = EIKONAL_EVERY as f32;
        let weight = self.batch.weights.eikonal * self.share * every;
        let (mut points, mut weights) = (Vec::new(), Vec::new());
        let start = mix(self.seed, 0xe1) as usize % EIKONAL_EVERY;
        for hit in (start..first.hits.len()).step_by(EIKONAL_EVERY) {
            points.push(first.x[hit] + self.jitter(hit as u64) * (NEAR * bounds.radius));
            weights.push(weight * f32::from(self.pixels[first.hits[hit]].count));
        }
        let pixels = count(self.pixels);
        let free = pixels.div_ceil(2 * EIKONAL_EVERY as u64);
        points.extend(
            (0..free).map(|i| bounds.center + in_ball(mix(self.seed, 0xba11 + i)) * bounds.radius),
        );
        let of_free = self.batch.weights.eikonal * self.share * pixels as f32 / (2.0 * free as f32);
        weights.resize(points.len(), of_free);
        let (mut f, mut g) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
        self.batch.setup.field.value_gradient(&points, &mut f, &mut g);
        self.tally.eikonal_points += points.len() as u64;
        for ((x, g), weight) in points.into_iter().zip(g).zip(weights) {
            let length = g.length();
            let excess = length - 1.0;
            self.tally.eikonal += f64::from(excess * excess);
            self.adjoints.push(
                0,
                x,
                0.0,
                g * (2.0 * weight * excess / length.max(f32::MIN_POSITIVE)),
            );
        }
    }

    /// A displacement with components about as large as a unit normal's, for hit `i`.
    fn jitter(&self, i: u64) -> Vec3 {
        (in_ball(mix(self.seed, 0x3a1 + 2 * i)) + in_ball(mix(self.seed, 0x3a2 + 2 * i)))
            .normalize_or_zero()
            * unit(mix(self.seed, 0x77 + i)) as f32
    }

    /// Pixels that a silhouette may cross.
    fn silhouettes(&mut self, pixels: &[Pixel], shader: &mut [f32]) -> Result<(), InvalidField> {
        let setup = &self.batch.setup;
        self.tally.edge_pixels += count(pixels);
        let places: Vec<estimate::Pixel> = pixels
            .iter()
            .map(|p| estimate::Pixel { camera: p.view as usize, x: p.x.into(), y: p.y.into() })
            .collect();
        let record = self.batch.estimator.record_surveyed(
            setup,
            &places,
            mix(self.seed, 0x51),
            &mut Survey::all_near(places.len()),
        )?;
        self.tally.rays += record.rays;
        let delta: Vec<Vec3> = pixels
            .iter()
            .zip(&record.radiance)
            .map(|(p, radiance)| self.score((*radiance).into(), *p))
            .collect();
        record.vjp(setup, &delta, Pass::Limited(self.batch.limit), shader, &mut self.adjoints);
        Ok(())
    }
}

/// The limit that fits use.
pub(crate) const LIMIT: f32 = 1.0;

/// The eikonal term is looked at in one of so many points.
const EIKONAL_EVERY: usize = 4;

/// How far from the surface the eikonal term looks closely, as a fraction of the bounding radius.
const NEAR: f32 = 0.1;

/// What is as it looks to this probability is not pushed: a pass over the parameters for nothing.
const CERTAIN: f32 = 1e-3;

/// A point uniform in the unit ball.
fn in_ball(bits: u64) -> Vec3 {
    let [a, b, c] = [1, 2, 3].map(|i| unit(mix(bits, i)));
    let (z, angle) = (2.0 * a - 1.0, 2.0 * std::f64::consts::PI * b);
    let across = (1.0 - z * z).sqrt();
    let point = DVec3::new(across * angle.cos(), across * angle.sin(), z) * c.cbrt();
    <Vec3 as Vector3<f32>>::of(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_fill_the_ball_evenly() {
        let n = 20_000;
        let points: Vec<Vec3> = (0..n).map(in_ball).collect();
        assert!(points.iter().all(|p| p.length() <= 1.0));
        let inner = points.iter().filter(|p| p.length() < 0.5).count() as f64 / n as f64;
        assert!((inner - 0.125).abs() < 0.01, "{inner} within half the radius");
        assert!(points.iter().sum::<Vec3>().length() / (n as f32) < 0.02);
    }
}

#[cfg(test)]
mod gradient_tests;
