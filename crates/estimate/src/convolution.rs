//! The estimators `was` and `loubet`: warps by convolution. V at a film position is a weighted mean
//! of the velocities of surface points hit by auxiliary rays around it.

use field::{Real, Vector3};
use glam::DVec2;
use random::{Name, Stream, gaussian};
use render::{InvalidField, Sample, Scene};
use warp::{Projection, SampleDivergence, Warp, WarpSample, WarpWithDivergence};

use crate::estimator::{Batch, Estimator, Filter, SilhouetteMask};
use crate::gaussian_samples::gaussian_samples;
use crate::record::{Area, AreaWarp, FilmWarpWithDivergence, Record, WarpedSample, chart};

/// The standard deviation of the cloud of auxiliary rays, in pixels.
const DEVIATION: f64 = 0.2;

/// Auxiliary rays of the harmonic mean. The quotient of two sums of n terms has a bias of about
/// 1/n.
const HARMONIC_RAYS: u32 = 16;

/// Auxiliary rays of the plain mean, as published.
const MEAN_RAYS: u32 = 4;

/// The exponent γ of the harmonic weights.
const EXPONENT: f64 = 3.0;

/// The least cos² in a harmonic weight: the weight of a hit seen edge-on at the sample would be
/// infinite.
const LEAST_BOUNDARY: f64 = 1e-6;

const AUXILIARY_RAYS: Name = Name::new("auxiliary rays around a position", 7);
const AUXILIARY_SHIFT: Name = Name::new("shift of a cloud of auxiliary rays", 8);

/// The weights of auxiliary rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Weights {
    /// 1/(exp(D/2) − 1 + B)^γ. D is the squared distance on the film from the sample to the ray, in
    /// variances of the cloud. B is cos² of the angle between ray and normal at a hit, which falls
    /// to zero at a silhouette, and 1 for a ray without a hit.
    ///
    /// Bangaru, Li and Durand, "Unbiased Warped-Area Sampling for Differentiable
    /// Rendering", SIGGRAPH Asia 2020, section 5.
    Harmonic,
    /// Equal weights for all hits of a cloud around a point near the sample. Silhouettes inside the
    /// cloud move with the mean of its hits, which is a bias.
    ///
    /// Loubet, Holzschuch and Jakob, "Reparameterizing Discontinuous Integrands for
    /// Differentiable Rendering", SIGGRAPH Asia 2019, section 4.
    Mean,
}

/// A warp by convolution under a Gaussian pixel filter.
#[derive(Clone, Copy, Debug)]
pub struct Convolution {
    rays: u32,
    weights: Weights,
}

/// A surface point that an auxiliary ray hits.
struct AuxiliaryHit<R: Real> {
    x: R::Vec3,
    /// J ∇f/|∇f|²: the film velocity per unit of −∂_θ f, in pixels per world unit.
    motion: [R; 2],
    /// cos² of the angle between ray and normal.
    boundary: R,
}

/// The weight of an auxiliary ray, and its derivative by the film position of the sample, per
/// pixel.
type Term<R> = (R, [R; 2]);

impl Convolution {
    /// Harmonic weights with 16 auxiliary rays per sample (`was`).
    pub fn harmonic() -> Self {
        Convolution { rays: HARMONIC_RAYS, weights: Weights::Harmonic }
    }

    /// The plain mean over 4 auxiliary rays per sample (`loubet`).
    pub fn mean() -> Self {
        Convolution { rays: MEAN_RAYS, weights: Weights::Mean }
    }

    /// The offset of auxiliary ray `index` from the centre of the cloud, in pixels.
    fn offset(index: u32, stream: Stream) -> DVec2 {
        DVec2::from(gaussian(stream.sobol(index))) * DEVIATION
    }

    /// The part of a stream for a sample. Its index is the film position, so that samples of
    /// different tiles have different offsets.
    fn part(stream: Stream, sample: &Sample) -> Stream {
        let [x, y] = sample.u.to_array().map(f64::to_bits);
        stream.at(sample.camera as u64).at(x).at(y)
    }

    /// The offset of the centre of a sample's cloud from the sample, in pixels.
    fn shift(&self, sample: &Sample, stream: Stream) -> DVec2 {
        match self.weights {
            Weights::Harmonic => DVec2::ZERO,
            Weights::Mean => Self::offset(0, Self::part(stream.named(AUXILIARY_SHIFT), sample)),
        }
    }

    /// V and ∇_u·V at film samples.
    fn warp<R: Real>(
        &self,
        scene: &Scene<'_, R>,
        samples: &[Sample],
        stream: Stream,
    ) -> Result<FilmWarpWithDivergence<R>, InvalidField> {
        let rays: Vec<Sample> = samples
            .iter()
            .flat_map(|sample| {
                let around = sample.u + self.shift(sample, stream);
                let own = Self::part(stream.named(AUXILIARY_RAYS), sample);
                (0..self.rays).map(move |j| Sample { u: around + Self::offset(j, own), ..*sample })
            })
            .collect();
        let hits = auxiliary_hits(scene, &rays)?;
        let mut out = WarpWithDivergence {
            warp: Warp { samples: Vec::new(), valid: vec![true; samples.len()] },
            derivatives: Vec::new(),
        };
        let n = self.rays as usize;
        for (i, (hits, rays)) in hits.chunks(n).zip(rays.chunks(n)).enumerate() {
            let terms = self.terms(&samples[i], stream, hits, rays);
            push(&mut out, i, hits, &terms, self.weights == Weights::Harmonic);
        }
        Ok(FilmWarpWithDivergence::new(out, (0..samples.len()).collect()))
    }

    /// The weights of the auxiliary rays of a sample.
    fn terms<R: Real>(
        &self,
        sample: &Sample,
        stream: Stream,
        hits: &[Option<AuxiliaryHit<R>>],
        rays: &[Sample],
    ) -> Vec<Term<R>> {
        match self.weights {
            Weights::Harmonic => {
                hits.iter().zip(rays).map(|(hit, ray)| harmonic(hit, sample.u - ray.u)).collect()
            }
            Weights::Mean => {
                let shift = self.shift(sample, stream);
                let log_density_du = (shift / (DEVIATION * DEVIATION)).to_array();
                let count = R::of(hits.iter().flatten().count().max(1) as f64);
                // The weights are constant. The density of the cloud's centre moves with the
                // sample; the gradient of its logarithm takes the place of their derivatives.
                let term = (R::one() / count, log_density_du.map(|v| R::of(v) / count));
                vec![term; hits.len()]
            }
        }
    }
}

/// A harmonic weight divided by the density of the cloud, and its derivative by the film position
/// of the sample. `off` is the vector from the ray to the sample, in pixels.
fn harmonic<R: Real>(hit: &Option<AuxiliaryHit<R>>, off: DVec2) -> Term<R> {
    let inverse_density = R::of((off.length_squared() / (2.0 * DEVIATION * DEVIATION)).exp());
    let boundary = hit.as_ref().map_or(R::one(), |s| s.boundary.max(R::of(LEAST_BOUNDARY)));
    let base = inverse_density - R::one() + boundary;
    let weight = inverse_density * base.powf(-R::of(EXPONENT));
    let rate = -R::of(EXPONENT) * weight * inverse_density / base;
    (weight, (off / (DEVIATION * DEVIATION)).to_array().map(|v| R::of(v) * rate))
}

/// Adds the points of one sample to the warp. With `normalise`, its weights are divided by their
/// sum.
fn push<R: Real>(
    out: &mut WarpWithDivergence<R>,
    ray: usize,
    hits: &[Option<AuxiliaryHit<R>>],
    terms: &[Term<R>],
    normalise: bool,
) {
    let (mut sum, mut rate) = (R::one(), [R::zero(); 2]);
    if normalise {
        sum = terms.iter().fold(R::zero(), |sum, (w, _)| sum + *w);
        rate = std::array::from_fn(|e| terms.iter().fold(R::zero(), |sum, (_, du)| sum + du[e]));
    }
    for (index, (hit, (weight, du))) in hits.iter().zip(terms).enumerate() {
        let Some(hit) = hit else { continue };
        let normalised = *weight / sum;
        let divergence = |e: usize| (du[e] - normalised * rate[e]) / sum * hit.motion[e];
        let a = hit.motion.map(|m| m * normalised);
        out.warp.samples.push(WarpSample { ray, index, x: hit.x, weight: normalised, a });
        let divergence_a = divergence(0) + divergence(1);
        out.derivatives.push(SampleDivergence { divergence_a, b: R::Vec3::zero() });
    }
}

/// The surface points at the first hits of rays; `None` for a ray without a hit.
fn auxiliary_hits<R: Real>(
    scene: &Scene<'_, R>,
    samples: &[Sample],
) -> Result<Vec<Option<AuxiliaryHit<R>>>, InvalidField> {
    let traced = scene.trace(samples)?;
    let rays: Vec<(usize, _, R)> = traced
        .iter()
        .enumerate()
        .filter_map(|(i, traced)| traced.and_then(|t| Some((i, t.ray, t.depth()?))))
        .collect();
    let x: Vec<R::Vec3> = rays.iter().map(|(_, ray, t)| ray.at(*t)).collect();
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    scene.field.value_gradient(&x, &mut f, &mut gradient);
    let mut out: Vec<Option<AuxiliaryHit<R>>> = samples.iter().map(|_| None).collect();
    for ((i, ray, _), (x, g)) in rays.into_iter().zip(x.into_iter().zip(gradient)) {
        let square = g.dot(g).max(R::min_positive_value());
        let chart = chart(&scene.cameras[samples[i].camera]);
        let jacobian = Projection::<R>::jacobian(&chart, x);
        let facing = g.dot(ray.direction);
        out[i] = Some(AuxiliaryHit {
            x,
            motion: jacobian.map(|row| row.dot(g) / square),
            boundary: facing * facing / square,
        });
    }
    Ok(out)
}

impl<R: Real> Estimator<R> for Convolution {
    fn filter(&self) -> Filter {
        Filter::Gaussian
    }

    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let spp = batch.counts.spp;
        let (samples, filter_du) = gaussian_samples(batch.pixels, spp, batch.stream);
        let primary = scene.primary(&samples)?;
        let film_warp = self.warp(scene, &samples, batch.stream)?;
        let background = scene.background_radiance(primary.samples.iter().map(|s| s.sample));
        let rows = primary.samples.iter().zip(background).zip(filter_du);
        let warped = rows.map(|((s, background), filter_du)| {
            let radiance_minus_baseline = s.radiance - background;
            WarpedSample { radiance_minus_baseline, filter_du, less_background: true }
        });
        let warp = Some(AreaWarp { film_warp, samples: warped.collect() });
        let radiance = primary.pixel_means(spp);
        let rays = samples.len() as u64 * u64::from(1 + self.rays);
        let area = vec![Area { warp, ..Area::uniform(primary, spp) }];
        Ok(Record { radiance, rays, area, ..Record::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec3;

    /// Three hits and a miss, and the film positions of their rays.
    fn cloud() -> (Vec<Option<AuxiliaryHit<f64>>>, Vec<DVec2>) {
        let hit =
            |x: f64, motion, boundary| Some(AuxiliaryHit { x: DVec3::splat(x), motion, boundary });
        let hits = vec![
            hit(0.1, [2.0, -1.0], 0.3),
            hit(0.2, [-0.5, 3.0], 0.01),
            None,
            hit(0.3, [1.0, 1.0], 0.8),
        ];
        let places = [[0.1, 0.2], [-0.15, 0.05], [0.3, -0.2], [-0.2, -0.25]];
        (hits, places.map(DVec2::from).to_vec())
    }

    /// The warp of a sample at u. The auxiliary rays and their densities are the same for every u.
    fn warp_at(u: DVec2) -> WarpWithDivergence<f64> {
        let (hits, places) = cloud();
        let density = |at: &DVec2| (-at.length_squared() / (2.0 * DEVIATION * DEVIATION)).exp();
        let terms: Vec<Term<f64>> = hits
            .iter()
            .zip(&places)
            .map(|(hit, at)| {
                // `harmonic` divides by the density around u; this is the density around the
                // origin.
                let (weight, du) = harmonic(hit, u - *at);
                let here = density(&(u - *at)) / density(at);
                (weight * here, du.map(|v| v * here))
            })
            .collect();
        let mut out = WarpWithDivergence {
            warp: Warp { samples: Vec::new(), valid: vec![true] },
            derivatives: Vec::new(),
        };
        push(&mut out, 0, &hits, &terms, true);
        out
    }

    #[test]
    fn divergence_with_harmonic_weights_matches_differences() {
        let f_dot = [0.7, -1.3, 0.4];
        let (h, here) = (1e-6, warp_at(DVec2::ZERO));
        let velocity = |u: DVec2| warp_at(u).warp.velocity(&f_dot)[0];
        let difference = (velocity(DVec2::X * h)[0] - velocity(-DVec2::X * h)[0]) / (2.0 * h)
            + (velocity(DVec2::Y * h)[1] - velocity(-DVec2::Y * h)[1]) / (2.0 * h);
        let divergence = here.divergence(&f_dot, &[DVec3::ZERO; 3])[0];
        assert!(difference.abs() > 0.1);
        assert_relative_eq!(divergence, difference, max_relative = 1e-6);
    }
}
