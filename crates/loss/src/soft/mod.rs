//! The photometric term with a soft surface: rays see all surfaces that have opacity, so a surface
//! can appear and vanish.
//!
//! A sharp surface moves along its normal only. A sheet in front of the object that has taken the
//! colours of the background would stay for ever, and so would a missing part.

use crate::opacity::{Chord, ChordPoints, INTERVALS, POINTS, radiance, value_vjp, weights};
use estimate::record::PointAdjoint;
use field::BackgroundRay;
use field::{SurfaceAdjoint, SurfaceBatch};
use glam::Vec3;
use random::{Purpose, Stream};
use render::{Camera, InvalidField, Sample, normals};
use trace::HitAdjoint;

use crate::batch::PixelLoss;
use crate::eikonal::NearPoint;
use crate::part::{Part, pixels_of};

/// An interval of less weight counts as empty: it has no opacity and needs no colour.
const LEAST_WEIGHT: f32 = 1e-3;

/// Coefficients of f below this, relative to the largest that one interval can give, are left out.
const NEGLIGIBLE: f32 = 1e-4;

/// The least weight of an interval whose middle counts as a point of the surface.
const SURFACE: f32 = 0.1;

/// The least weight of an interval that can be carved.
const OPAQUE: f32 = 0.25;

/// The least transmittance at which a ray trains the background.
const LEAST_TRANSMITTANCE: f32 = 1e-3;

/// The intervals with a colour, as one vector per quantity. The middle of an interval stands for
/// all of it.
#[derive(Default)]
struct Colored {
    /// The number of the interval: [`INTERVALS`] for each chord.
    interval: Vec<usize>,
    x: Vec<Vec3>,
    gradient: Vec<Vec3>,
    normal: Vec<Vec3>,
    direction: Vec<Vec3>,
}

impl Colored {
    fn batch(&self) -> SurfaceBatch<'_, f32> {
        SurfaceBatch { x: &self.x, normal: &self.normal, direction: &self.direction }
    }
}

/// The rays of a part through a soft surface.
struct SoftRays {
    background: Vec<BackgroundRay<f32>>,
    chords: Vec<Chord>,
    /// The number of each chord's sample in the part.
    samples: Vec<usize>,
    points: ChordPoints,
    /// [`INTERVALS`] weights for each chord.
    weights: Vec<f32>,
    /// The transmittance behind each chord.
    last: Vec<f32>,
}

impl SoftRays {
    /// `sharpness` is per world unit.
    fn new(part: &Part<'_>, samples: &[Sample], sharpness: f32) -> Self {
        let scene = &part.batch.scene;
        let ball = scene.bounding_ball();
        let background: Vec<BackgroundRay<f32>> =
            samples.iter().map(|sample| scene.background_ray(sample)).collect();
        let (mut chords, mut of_chord) = (Vec::new(), Vec::new());
        for (sample, ray) in background.iter().enumerate() {
            let (origin, direction) = (ray.origin, ray.direction);
            let ends = ball.clip(origin, direction);
            if let Some((near, far)) = ends {
                chords.push(Chord { origin, direction, ends: [near, far] });
                of_chord.push(sample);
            }
        }
        let stream = Stream::new(part.seed, Purpose::RayPoints);
        let points = ChordPoints::new(scene.field, &chords, sharpness, stream);
        let mut all = vec![0.0; chords.len() * INTERVALS];
        let own = points.f.chunks_exact(POINTS).zip(all.chunks_exact_mut(INTERVALS));
        let last = own.map(|(f, own)| weights(sharpness, f, LEAST_WEIGHT, own)).collect();
        SoftRays { background, chords, samples: of_chord, points, weights: all, last }
    }

    /// Refuses values of f that are no numbers.
    fn check(&self, cameras: &[Camera], samples: &[Sample]) -> Result<(), InvalidField> {
        match self.points.f.iter().position(|f| !f.is_finite()) {
            Some(i) => Err(InvalidField::at(cameras, samples[self.samples[i / POINTS]])),
            None => Ok(()),
        }
    }

    /// The intervals with a colour, in order.
    fn colored(&self, part: &Part<'_>) -> Colored {
        let mut out = Colored::default();
        for (i, _) in self.weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let (chord, k) = (self.chords[i / INTERVALS], i % INTERVALS);
            let t = &self.points.t[i / INTERVALS * POINTS + k..][..2];
            out.interval.push(i);
            out.x.push(chord.at((t[0] + t[1]) * 0.5));
            out.direction.push(chord.direction);
        }
        out.gradient.resize(out.x.len(), Vec3::ZERO);
        let mut f = vec![0.0; out.x.len()];
        part.batch.scene.field.value_gradient(&out.x, &mut f, &mut out.gradient);
        out.normal = normals::<f32>(&out.gradient);
        out
    }
}

impl Part<'_> {
    /// Adds the photometric term of all pixels with a soft surface. `sharpness` is per bounding
    /// radius.
    pub(crate) fn add_soft_pixels(&mut self, sharpness: f32) -> Result<(), InvalidField> {
        let scene = self.batch.scene;
        let sharpness = sharpness / scene.radius();
        let samples = self.samples();
        let rays = SoftRays::new(self, &samples, sharpness);
        rays.check(scene.cameras, &samples)?;
        self.stats.rays += samples.len() as u64;
        self.stats.pixels += pixels_of(self.pixels);
        let colored = rays.colored(self);
        let mut rgb = vec![Vec3::ZERO; colored.x.len()];
        scene.shader.radiance(&colored.batch(), &mut rgb);
        let mut colors = vec![Vec3::ZERO; rays.weights.len()];
        colored.interval.iter().zip(&rgb).for_each(|(i, rgb)| colors[*i] = *rgb);
        let mut background = vec![Vec3::ZERO; samples.len()];
        scene.background.radiance(&rays.background, &mut background);
        let mut last = vec![1.0; samples.len()];
        let mut seen = background.clone();
        for (i, sample) in rays.samples.iter().copied().enumerate() {
            let own = i * INTERVALS..(i + 1) * INTERVALS;
            last[sample] = rays.last[i];
            let colors = colors[own.clone()].iter().copied();
            seen[sample] =
                radiance::<f32>(&rays.weights[own], colors, rays.last[i], background[sample]);
        }
        let pixels = self.pixels.iter().zip(&seen);
        let losses: Vec<PixelLoss> = pixels.map(|(p, seen)| self.batch.loss(*seen, p)).collect();
        let own = losses.iter().zip(self.pixels);
        let delta: Vec<Vec3> = own.map(|(loss, p)| self.add_loss(loss, p)).collect();
        self.losses = losses.iter().map(|loss| Some(loss.loss)).collect();
        self.add_color_adjoints(&rays, &colored, &delta);
        self.add_opacity_adjoints(&rays, &colors, &background, &delta, sharpness);
        let weighted = delta.iter().zip(&last).map(|(delta, last)| {
            if *last > LEAST_TRANSMITTANCE { *delta * *last } else { Vec3::ZERO }
        });
        let adjoint: Vec<Vec3> = weighted.collect();
        if self.batch.trains_background {
            let sum = &mut self.sums.background;
            scene.background.add_parameter_vjp(&rays.background, &adjoint, sum);
        }
        let near: Vec<NearPoint> = colored
            .interval
            .iter()
            .zip(&colored.x)
            .filter_map(|(i, x)| {
                let (weight, pixel) = (rays.weights[*i], rays.samples[*i / INTERVALS]);
                let weight = (weight > SURFACE).then_some(weight)?;
                let weight = weight * f32::from(self.pixels[pixel].count);
                Some(NearPoint { pixel, x: *x, weight })
            })
            .collect();
        self.add_eikonal(&near);
        self.add_bending(&near);
        self.add_guide(&samples);
        let is_surface = |i: &usize| rays.weights[*i] > OPAQUE;
        let points = colored.interval.iter().zip(&colored.x).filter(|(i, _)| is_surface(i));
        self.surface = points.map(|(i, x)| (rays.samples[*i / INTERVALS], *x)).collect();
        Ok(())
    }

    /// Adds the adjoints of the colours: to the head, and through the normals to ∇f. The points
    /// stay where they are.
    fn add_color_adjoints(&mut self, rays: &SoftRays, colored: &Colored, delta: &[Vec3]) {
        let of_interval = |i: &usize| delta[rays.samples[*i / INTERVALS]] * rays.weights[*i];
        let adjoint: Vec<Vec3> = colored.interval.iter().map(of_interval).collect();
        let mut bars = SurfaceAdjoint::zeros(adjoint.len());
        let shader = self.batch.scene.shader;
        shader.add_vjp(&colored.batch(), &adjoint, &mut bars, &mut self.sums.shader);
        for (j, x) in colored.x.iter().enumerate() {
            let c = HitAdjoint::<f32>::normal_coefficient(colored.gradient[j], bars.normal[j]);
            self.adjoints.push(PointAdjoint { pixel: 0, x: *x, alpha: 0.0, c });
        }
    }

    /// Adds the adjoints of the values of f.
    fn add_opacity_adjoints(
        &mut self,
        rays: &SoftRays,
        colors: &[Vec3],
        background: &[Vec3],
        delta: &[Vec3],
        sharpness: f32,
    ) {
        let mut along = [0.0; INTERVALS];
        for (i, chord) in rays.chords.iter().enumerate() {
            let sample = rays.samples[i];
            let delta = delta[sample];
            let own = i * INTERVALS..(i + 1) * INTERVALS;
            let colors = along.iter_mut().zip(&colors[own.clone()]);
            colors.for_each(|(along, color)| *along = delta.dot(*color));
            let (t, f) = (&rays.points.t[i * POINTS..][..POINTS], &rays.points.f[i * POINTS..]);
            let last = (rays.last[i], delta.dot(background[sample]));
            let mut bars = [0.0; POINTS];
            value_vjp(sharpness, &f[..POINTS], &rays.weights[own], last, &along, &mut bars);
            let least = NEGLIGIBLE * delta.length() * sharpness;
            for (t, alpha) in t.iter().zip(bars).filter(|(_, alpha)| alpha.abs() > least) {
                let x = chord.at(*t);
                self.adjoints.push(PointAdjoint { pixel: 0, x, alpha, c: Vec3::ZERO });
            }
        }
    }
}

mod guide;
#[cfg(test)]
mod tests;
