//! The stages of pixels with a soft surface: rays see all surfaces that have opacity, so a surface
//! can appear and vanish.
//!
//! A sharp surface moves along its normal only. A sheet in front of the object that has taken the
//! colours of the background would stay for ever, and so would a missing part.

use field::BackgroundRay;
use field::{SurfaceAdjoint, SurfaceBatch};
use glam::Vec3;
use multiview::stereo::Guide;
use random::{Name, Stream};
use render::{InvalidField, Sample, normals};
use trace::HitAdjoint;

use crate::carve::carve;
use crate::drawn::{Drawn, NearPoint, pixels_of};
use crate::objective::PixelLoss;
use crate::opacity::{Chord, ChordPoints, INTERVALS, POINTS, radiance, value_vjp, weights};
use crate::photometry::Draw;
use crate::regularisers::regularise;
use crate::reversed::Reversed;
use crate::sums::PartSums;
use guide::add_guide;

/// An interval of less weight counts as empty: it has no opacity and needs no colour.
const LEAST_WEIGHT: f32 = 1e-3;

/// Adjoints of small size are passed on by chance, with a probability in proportion to their size,
/// and are then as large as this: the same in the mean. For coefficients of f, relative to the
/// largest that one interval can give. Smaller ones are a third of the sum of sizes, and nine in ten
/// of all.
const LEAST_COEFFICIENT: f32 = 1e-2;

/// The same for the weights of intervals with a colour.
const LEAST_COLOR: f32 = 0.05;

const RAY_POINTS: Name = Name::new("points of a ray whose opacity is summed", 25);
const CHANCES: Name = Name::new("small adjoints of a soft surface that are passed on", 34);

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
    /// Adds interval number `j` of others.
    fn push_from(&mut self, others: &Colored, j: usize) {
        self.interval.push(others.interval[j]);
        self.x.push(others.x[j]);
        self.gradient.push(others.gradient[j]);
        self.normal.push(others.normal[j]);
        self.direction.push(others.direction[j]);
    }

    fn batch(&self) -> SurfaceBatch<'_, f32> {
        SurfaceBatch { x: &self.x, normal: &self.normal, direction: &self.direction }
    }
}

/// A number whose mean is `value`: itself if its size is at least `least`, or else ±`least` or 0.
fn by_chance(value: f32, least: f32, stream: Stream) -> f32 {
    let size = value.abs();
    if size >= least {
        value
    } else if (stream.unit() as f32) * least < size {
        least.copysign(value)
    } else {
        0.0
    }
}

/// The rays of a part of the pixels, with the opacity along them.
pub(crate) struct Traced<'a> {
    drawn: Drawn<'a>,
    /// The sharpness of the surface, per world unit.
    sharpness: f32,
    samples: Vec<Sample>,
    background: Vec<BackgroundRay<f32>>,
    chords: Vec<Chord>,
    /// The number of each chord's sample in the part.
    of_chord: Vec<usize>,
    points: ChordPoints,
    /// [`INTERVALS`] weights for each chord.
    weights: Vec<f32>,
    /// The transmittance behind each chord.
    last: Vec<f32>,
}

impl<'a> Traced<'a> {
    /// One ray through each pixel. `sharpness` is per bounding radius.
    pub(crate) fn new(drawn: Drawn<'a>, sharpness: f32) -> Result<Self, InvalidField> {
        let scene = &drawn.objective.scene;
        let sharpness = sharpness / scene.radius();
        let samples = drawn.samples();
        let ball = scene.bounding_ball();
        let background: Vec<BackgroundRay<f32>> =
            samples.iter().map(|sample| scene.background_ray(sample)).collect();

        let (mut chords, mut of_chord) = (Vec::new(), Vec::new());
        for (sample, ray) in background.iter().enumerate() {
            let (origin, direction) = (ray.origin, ray.direction);
            if let Some((near, far)) = ball.clip(origin, direction) {
                chords.push(Chord { origin, direction, ends: [near, far] });
                of_chord.push(sample);
            }
        }

        let stream = drawn.stream.named(RAY_POINTS);
        let points = ChordPoints::new(scene.field, &chords, sharpness, stream);
        if let Some(i) = points.f.iter().position(|f| !f.is_finite()) {
            return Err(InvalidField::at(scene.cameras, samples[of_chord[i / POINTS]]));
        }
        let mut all = vec![0.0; chords.len() * INTERVALS];
        let own = points.f.chunks_exact(POINTS).zip(all.chunks_exact_mut(INTERVALS));
        let last = own.map(|(f, own)| weights(sharpness, f, LEAST_WEIGHT, own)).collect();
        let weights = all;
        Ok(Traced {
            drawn,
            sharpness,
            samples,
            background,
            chords,
            of_chord,
            points,
            weights,
            last,
        })
    }

    /// The intervals with a colour, in order.
    fn colored(&self) -> Colored {
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
        let field = self.drawn.objective.scene.field;
        field.value_gradient(&out.x, &mut f, &mut out.gradient);
        out.normal = normals::<f32>(&out.gradient);
        out
    }

    /// Computes the radiance along the rays.
    pub(crate) fn shade(self) -> Shaded<'a> {
        let scene = &self.drawn.objective.scene;
        let colored = self.colored();
        let mut rgb = vec![Vec3::ZERO; colored.x.len()];
        scene.shader.radiance(&colored.batch(), &mut rgb);
        let mut colors = vec![Vec3::ZERO; self.weights.len()];
        colored.interval.iter().zip(&rgb).for_each(|(i, rgb)| colors[*i] = *rgb);

        let mut behind = vec![Vec3::ZERO; self.samples.len()];
        scene.background.radiance(&self.background, &mut behind);

        let mut seen = behind.clone();
        for (i, sample) in self.of_chord.iter().copied().enumerate() {
            let own = i * INTERVALS..(i + 1) * INTERVALS;
            let colors = colors[own.clone()].iter().copied();
            seen[sample] =
                radiance::<f32>(&self.weights[own], colors, self.last[i], behind[sample]);
        }
        Shaded { traced: self, colored, colors, behind, seen }
    }
}

/// The rays of a part of the pixels, with their radiance.
pub(crate) struct Shaded<'a> {
    traced: Traced<'a>,
    colored: Colored,
    /// The radiance of each interval of each chord; zero for an empty one.
    colors: Vec<Vec3>,
    /// The radiance of the background behind each sample.
    behind: Vec<Vec3>,
    /// The radiance of each sample.
    seen: Vec<Vec3>,
}

impl<'a> Shaded<'a> {
    /// Compares the radiance with the photographs. `depths` guide the surface.
    pub(crate) fn compare(self, depths: Option<Guide<'a>>) -> Compared<'a> {
        let Drawn { objective, draws, .. } = self.traced.drawn;
        let shown = draws.iter().zip(&self.seen);
        let pixels: Vec<PixelLoss> =
            shown.map(|(draw, seen)| objective.targets.loss(*seen, draw)).collect();
        Compared { shaded: self, depths, pixels }
    }
}

/// A part of the pixels that were compared with the photographs.
pub(crate) struct Compared<'a> {
    shaded: Shaded<'a>,
    depths: Option<Guide<'a>>,
    pixels: Vec<PixelLoss>,
}

impl<'a> Compared<'a> {
    /// The adjoints of all terms but carving.
    ///
    /// It follows the comparison in the same task: what a part has traced is still in the cache.
    pub(crate) fn reverse(self, sums: PartSums) -> Uncarved<'a> {
        let Compared { shaded, depths, pixels } = self;
        let Traced { drawn, samples, .. } = &shaded.traced;
        let drawn = *drawn;
        let mut out = Reversed::new(&drawn, sums);
        out.stats.rays += samples.len() as u64;
        out.stats.pixels += pixels_of(drawn.draws);

        let objective = drawn.objective;
        let own = pixels.iter().zip(drawn.draws);
        let delta: Vec<Vec3> =
            own.map(|(loss, draw)| out.add_loss(objective, loss, draw)).collect();
        shaded.reverse_colors(&delta, &mut out);
        shaded.reverse_opacity(&delta, &mut out);
        if drawn.objective.wanted.background {
            shaded.reverse_background(&delta, &mut out);
        }

        regularise(&drawn, &shaded.near_points(), &mut out);
        if let Some(depths) = depths {
            add_guide(&drawn, samples, &depths, &mut out);
        }
        let carving = drawn.objective.carving;
        let opaque = carving.map(|_| shaded.opaque_points().collect()).unwrap_or_default();
        Uncarved { drawn, pixels, opaque, out }
    }
}

/// A part of the pixels with the adjoints of all terms but carving, which needs the losses of all
/// parts.
pub(crate) struct Uncarved<'a> {
    drawn: Drawn<'a>,
    pixels: Vec<PixelLoss>,
    /// The points that can be carved, each with the number of its pixel; none without carving.
    opaque: Vec<(usize, Vec3)>,
    out: Reversed,
}

impl Uncarved<'_> {
    /// The photometric loss of each pixel.
    pub(crate) fn losses(&self) -> Vec<Option<f32>> {
        self.pixels.iter().map(|own| Some(own.loss)).collect()
    }

    /// The adjoints of all terms: `pushes` has one number for each pixel of the round, or is empty.
    pub(crate) fn carve(mut self, pushes: &[f32]) -> Reversed {
        carve(&self.drawn, self.opaque.into_iter(), pushes, &mut self.out);
        self.out
    }
}

impl Shaded<'_> {
    /// The intervals with a colour: the number of the pixel, the weight and the middle.
    fn intervals(&self) -> impl Iterator<Item = (usize, f32, Vec3)> {
        let Traced { of_chord, weights, .. } = &self.traced;
        let own = self.colored.interval.iter().zip(&self.colored.x);
        own.map(|(i, x)| (of_chord[*i / INTERVALS], weights[*i], *x))
    }

    /// The points that count as surface for the regularisers.
    fn near_points(&self) -> Vec<NearPoint> {
        let count = |draw: &Draw| f32::from(draw.count);
        let surface = self.intervals().filter(|(_, weight, _)| *weight > SURFACE);
        let near = surface.map(|(pixel, weight, x)| {
            let weight = weight * count(&self.traced.drawn.draws[pixel]);
            NearPoint { pixel, x, weight }
        });
        near.collect()
    }

    /// The points that can be carved, each with the number of its pixel; none without carving.
    fn opaque_points(&self) -> impl Iterator<Item = (usize, Vec3)> {
        let opaque = self.intervals().filter(|(_, weight, _)| *weight > OPAQUE);
        opaque.map(|(pixel, _, x)| (pixel, x))
    }

    /// Adds the adjoints of the colours: to the head, and through the normals to ∇f. The points
    /// stay where they are.
    fn reverse_colors(&self, delta: &[Vec3], out: &mut Reversed) {
        let Shaded { traced, colored, .. } = self;
        let stream = traced.drawn.stream.named(CHANCES).at(0);
        let (mut kept, mut adjoint) = (Colored::default(), Vec::new());
        for (j, i) in colored.interval.iter().enumerate() {
            let weight = by_chance(traced.weights[*i], LEAST_COLOR, stream.at(*i as u64));
            if weight > 0.0 {
                kept.push_from(colored, j);
                adjoint.push(delta[traced.of_chord[*i / INTERVALS]] * weight);
            }
        }
        let mut bars = SurfaceAdjoint::zeros(adjoint.len());
        let shader = traced.drawn.objective.scene.shader;
        shader.add_vjp(&kept.batch(), &adjoint, &mut bars, &mut out.sums.shader);
        for (j, x) in kept.x.iter().enumerate() {
            let c = HitAdjoint::<f32>::normal_coefficient(kept.gradient[j], bars.normal[j]);
            out.push_gradient(*x, c);
        }
    }

    /// Adds the adjoints of the values of f.
    fn reverse_opacity(&self, delta: &[Vec3], out: &mut Reversed) {
        let Traced { drawn, sharpness, chords, of_chord, points, weights, last, .. } = &self.traced;
        let stream = drawn.stream.named(CHANCES).at(1);
        let mut along = [0.0; INTERVALS];
        for (i, chord) in chords.iter().enumerate() {
            let sample = of_chord[i];
            let delta = delta[sample];
            let own = i * INTERVALS..(i + 1) * INTERVALS;
            let colors = along.iter_mut().zip(&self.colors[own.clone()]);
            colors.for_each(|(along, color)| *along = delta.dot(*color));

            let (t, f) = (&points.t[i * POINTS..][..POINTS], &points.f[i * POINTS..]);
            let last = (last[i], delta.dot(self.behind[sample]));
            let mut bars = [0.0; POINTS];
            value_vjp(*sharpness, &f[..POINTS], &weights[own], last, &along, &mut bars);

            let least = LEAST_COEFFICIENT * delta.length() * sharpness;
            let stream = stream.at(i as u64);
            for (k, (t, alpha)) in t.iter().zip(bars).enumerate() {
                let alpha = by_chance(alpha, least, stream.at(k as u64));
                if alpha != 0.0 {
                    out.push_value(chord.at(*t), alpha);
                }
            }
        }
    }

    /// Adds the gradient by the parameters of the background.
    fn reverse_background(&self, delta: &[Vec3], out: &mut Reversed) {
        let Traced { drawn, background, of_chord, last, .. } = &self.traced;
        let mut transmittance = vec![1.0; delta.len()];
        of_chord.iter().zip(last).for_each(|(sample, last)| transmittance[*sample] = *last);
        let weighted = delta.iter().zip(transmittance).map(|(delta, last)| {
            if last > LEAST_TRANSMITTANCE { *delta * last } else { Vec3::ZERO }
        });
        let adjoint: Vec<Vec3> = weighted.collect();
        let sum = &mut out.sums.background;
        drawn.objective.scene.background.add_parameter_vjp(background, &adjoint, sum);
    }
}

mod guide;
#[cfg(test)]
mod tests;
