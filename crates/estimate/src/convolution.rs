//! Warps by convolution: V at a film position is a weighted mean of the velocities that auxiliary
//! rays around it see.

use field::{Real, Vector3};
use glam::DVec2;
use warp::{Kept, Projection};

use super::pixels::{check_valid, first_invalid};
use super::record::AreaWarp;
use super::warped::{gaussian_samples, means, plain_area};
use super::{Estimator, Pixel, Record, Sample, Setup, Warped};
use crate::InvalidField;
use random::{gaussian, mix, sobol};

/// The width of the cloud of auxiliary rays, in pixels: its standard deviation.
const DEVIATION: f64 = 0.2;

/// Auxiliary rays of the harmonic mean. The quotient of two sums of n terms is off by about 1/n.
const HARMONIC_RAYS: u32 = 16;

/// Auxiliary rays of the plain mean, as published.
const MEAN_RAYS: u32 = 4;

/// The exponent of harmonic weights.
const EXPONENT: f64 = 3.0;

/// Of hits that see a surface edge-on, the boundary test would vanish.
const LEAST: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Weights {
    /// 1/(exp(D) − 1 + B)^γ, D the squared distance on the film in variances of the cloud, B = cos²
    /// at a hit, which falls to zero at a silhouette, and 1 for a ray that misses (Bangaru, Li and
    /// Durand 2020, section 5).
    Harmonic,
    /// The same for all hits; V belongs to a cloud about a point τ near the sample, and moves the
    /// whole cloud (Loubet, Holzschuch and Jakob 2019, section 4). Silhouettes inside the cloud
    /// move with their mean: biased.
    Mean,
}

/// A warp by convolution under a Gaussian pixel filter.
#[derive(Clone, Copy, Debug)]
pub struct Convolution {
    spp: u32,
    rays: u32,
    weights: Weights,
}

/// A surface point that an auxiliary ray hits.
struct Seen<R: Real> {
    x: R::Vec3,
    /// J ∇f/|∇f|²: minus the film velocity per unit of ∂f.
    motion: [R; 2],
    /// cos².
    boundary: R,
}

impl Convolution {
    /// Harmonic weights.
    pub fn harmonic(spp: u32) -> Self {
        Convolution { spp, rays: HARMONIC_RAYS, weights: Weights::Harmonic }
    }

    /// The plain mean.
    pub fn mean(spp: u32) -> Self {
        Convolution { spp, rays: MEAN_RAYS, weights: Weights::Mean }
    }

    /// A normal offset on the film, for sample `index`.
    fn offset(index: u32, seed: u64) -> DVec2 {
        DVec2::from(gaussian(sobol(index, seed))) * DEVIATION
    }

    fn warp<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        samples: &[Sample],
        seed: u64,
    ) -> Result<Warped<R>, InvalidField> {
        // By place, not by number: a batch is a tile, and tiles are not to share their offsets.
        let stream = |i: usize| {
            let [x, y] = samples[i].u.to_array().map(f64::to_bits);
            mix(mix(mix(seed, 0xa0c5 + samples[i].camera as u64), x), y)
        };
        let shift = |i: usize| match self.weights {
            Weights::Harmonic => DVec2::ZERO,
            Weights::Mean => Self::offset(0, mix(stream(i), 1)),
        };
        let rays: Vec<Sample> = samples
            .iter()
            .enumerate()
            .flat_map(|(i, sample)| {
                let around = sample.u + shift(i);
                (0..self.rays)
                    .map(move |j| Sample { u: around + Self::offset(j, stream(i)), ..*sample })
            })
            .collect();
        let seen = see(setup, &rays)?;
        let mut kept =
            Kept { rays: samples.len(), valid: vec![true; samples.len()], ..Kept::default() };
        let per_sample = seen.chunks(self.rays as usize).zip(rays.chunks(self.rays as usize));
        for (i, (seen, rays)) in per_sample.enumerate() {
            let terms: Vec<(R, [R; 2])> = match self.weights {
                Weights::Harmonic => seen
                    .iter()
                    .zip(rays)
                    .map(|(s, ray)| harmonic(s, samples[i].u - ray.u))
                    .collect(),
                Weights::Mean => {
                    let turn = (shift(i) / (DEVIATION * DEVIATION)).to_array();
                    let hits = R::of(seen.iter().flatten().count().max(1) as f64);
                    // ∇ ln of the cloud's density at the sample, which takes the place of the
                    // weights' derivatives.
                    seen.iter().map(|_| (R::one() / hits, turn.map(|v| R::of(v) / hits))).collect()
                }
            };
            push(&mut kept, i, seen, &terms, self.weights == Weights::Harmonic);
        }
        Ok(Warped::new(kept, (0..samples.len()).collect()))
    }
}

/// A harmonic weight over the cloud's density, and its derivative as the sample moves; `off` from
/// the ray to the sample.
fn harmonic<R: Real>(seen: &Option<Seen<R>>, off: DVec2) -> (R, [R; 2]) {
    let grown = R::of((off.length_squared() / (2.0 * DEVIATION * DEVIATION)).exp());
    let boundary = seen.as_ref().map_or(R::one(), |s| s.boundary.max(R::of(LEAST)));
    let base = grown - R::one() + boundary;
    let weight = grown * base.powf(-R::of(EXPONENT));
    let rate = -R::of(EXPONENT) * weight * grown / base;
    (weight, (off / (DEVIATION * DEVIATION)).to_array().map(|v| R::of(v) * rate))
}

/// Adds the points of one sample. `terms` has a weight and its film gradient for each.
fn push<R: Real>(
    kept: &mut Kept<R>,
    ray: usize,
    seen: &[Option<Seen<R>>],
    terms: &[(R, [R; 2])],
    normalise: bool,
) {
    let (mut sum, mut rate) = (R::one(), [R::zero(); 2]);
    if normalise {
        sum = terms.iter().fold(R::zero(), |sum, (w, _)| sum + *w);
        rate = std::array::from_fn(|e| terms.iter().fold(R::zero(), |sum, (_, du)| sum + du[e]));
    }
    for (index, (seen, (weight, du))) in seen.iter().zip(terms).enumerate() {
        let Some(seen) = seen else { continue };
        let share = *weight / sum;
        let divergence = |e: usize| (du[e] - share * rate[e]) / sum * seen.motion[e];
        kept.points.push(seen.x);
        kept.ray.push(ray);
        kept.index.push(index);
        kept.weight.push(share);
        kept.a.push(seen.motion.map(|m| m * share));
        kept.divergence_a.push(divergence(0) + divergence(1));
        kept.b.push(R::Vec3::zero());
    }
}

/// The surface points that rays hit.
fn see<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
) -> Result<Vec<Option<Seen<R>>>, InvalidField> {
    let (rays, found) = setup.find(samples);
    check_valid(setup, samples, first_invalid(&found))?;
    let mut x: Vec<R::Vec3> = Vec::new();
    let hits: Vec<Option<usize>> = rays
        .iter()
        .zip(&found)
        .map(|(ray, found)| {
            let (Some(ray), Some(found)) = (ray, found) else { return None };
            (found.outcome == trace::Outcome::Hit).then(|| {
                x.push(ray.at(found.t));
                x.len() - 1
            })
        })
        .collect();
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    setup.field.value_gradient(&x, &mut f, &mut gradient);
    Ok(hits
        .into_iter()
        .enumerate()
        .map(|(i, hit)| {
            let (hit, direction) = (hit?, rays[i]?.direction);
            let g = gradient[hit];
            let square = g.dot(g).max(R::min_positive_value());
            let jacobian = Projection::<R>::jacobian(&setup.cameras[samples[i].camera], x[hit]);
            let facing = g.dot(direction);
            Some(Seen {
                x: x[hit],
                motion: jacobian.map(|row| row.dot(g) / square),
                boundary: facing * facing / square,
            })
        })
        .collect())
}

impl<R: Real> Estimator<R> for Convolution {
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
    ) -> Result<Record<R>, InvalidField> {
        let (samples, filter_du) = gaussian_samples(pixels, self.spp, seed);
        let primary = setup.primary(&samples);
        check_valid(setup, &samples, primary.invalid)?;
        let warped = self.warp(setup, &samples, seed)?;
        let excess = primary.radiance.iter().map(|l| setup.excess(*l)).collect();
        let radiance = means::<R>(&primary.radiance, self.spp);
        let rays = samples.len() as u64 * u64::from(1 + self.rays);
        let warp = Some(AreaWarp { warped, excess, filter_du });
        let area = super::Area { warp, ..plain_area(samples, primary, self.spp) };
        Ok(Record { radiance, rays, area: vec![area], ..Record::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Hits at (0.1, 0.2) and so on, one ray that misses.
    fn cloud() -> Vec<(Option<Seen<f64>>, DVec2)> {
        let seen =
            |x: f64, motion, boundary| Some(Seen { x: glam::DVec3::splat(x), motion, boundary });
        vec![
            (seen(0.1, [2.0, -1.0], 0.3), DVec2::new(0.1, 0.2)),
            (seen(0.2, [-0.5, 3.0], 0.01), DVec2::new(-0.15, 0.05)),
            (None, DVec2::new(0.3, -0.2)),
            (seen(0.3, [1.0, 1.0], 0.8), DVec2::new(-0.2, -0.25)),
        ]
    }

    fn kept(u: DVec2) -> Kept<f64> {
        // The auxiliary rays stay where they are, and so do the densities that they were drawn by.
        let (seen, places): (Vec<_>, Vec<_>) = cloud().into_iter().unzip();
        let density = |at: &DVec2| (-at.length_squared() / (2.0 * DEVIATION * DEVIATION)).exp();
        let terms: Vec<(f64, [f64; 2])> = seen
            .iter()
            .zip(&places)
            .map(|(seen, at)| {
                // `harmonic` takes the density at the sample; here it is that at the origin.
                let (weight, du) = harmonic(seen, u - *at);
                let here = (-(u - *at).length_squared() / (2.0 * DEVIATION * DEVIATION)).exp()
                    / density(at);
                (weight * here, du.map(|v| v * here))
            })
            .collect();
        let mut kept = Kept { rays: 1, valid: vec![true], ..Kept::default() };
        push(&mut kept, 0, &seen, &terms, true);
        kept
    }

    #[test]
    fn the_divergence_of_harmonic_weights_matches_differences() {
        let f_dot = [0.7, -1.3, 0.4];
        let (h, here) = (1e-6, kept(DVec2::ZERO));
        let velocity = |u: DVec2| kept(u).velocity(&f_dot)[0];
        let difference = (velocity(DVec2::X * h)[0] - velocity(-DVec2::X * h)[0]) / (2.0 * h)
            + (velocity(DVec2::Y * h)[1] - velocity(-DVec2::Y * h)[1]) / (2.0 * h);
        let divergence = here.divergence(&f_dot, &[glam::DVec3::ZERO; 3])[0];
        assert!(difference.abs() > 0.1);
        assert_relative_eq!(divergence, difference, max_relative = 1e-6);
    }
}
