//! The gradient of an image loss by all parameters of the field, reverse mode.

use boundary::Edges;
use field::{Real, Vector3};

use super::image::edge_samples;
use super::pixels::{CHUNK, check_valid, pixel_samples};
use super::warping::Adjoints;
use super::{Estimator, Sample, Sampling, Setup, ordered_sum, render};
use crate::error::InvalidField;
use crate::film::Film;
use crate::sampler::mix;

/// The gradient of ½ Σ (I − target)².
#[derive(Clone, Debug)]
pub struct TargetGradient<R> {
    /// The loss, from the image that gave the adjoints.
    pub loss: f64,
    /// The gradient by the field's parameters.
    pub parameters: Vec<R>,
    /// The estimated standard error: relative L2 over the parameters, from independent replicates.
    pub standard_error: Option<f64>,
}

const REPLICATES: u32 = 4;

/// The gradient of ½ Σ (I − target)², summed over pixels and channels, for the setup's first camera.
///
/// The image that gives the adjoints and the samples that are differentiated are independent, so that the product of
/// the two has no bias.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn target_gradient<R: Real>(
    setup: &Setup<'_, R>,
    target: &Film,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<TargetGradient<R>, InvalidField> {
    let image = render(setup, 0, sampling.spp, mix(sampling.seed, 1), &|p| progress(0.2 * p))?;
    let mut loss = 0.0;
    let adjoint: Vec<R::Vec3> = image
        .film
        .pixels
        .iter()
        .zip(&target.pixels)
        .map(|(image, target)| {
            R::Vec3::from_array(std::array::from_fn(|c| {
                let residual = f64::from(image[c]) - f64::from(target[c]);
                loss += 0.5 * residual * residual;
                R::of(residual)
            }))
        })
        .collect();

    let replicates = REPLICATES.min(sampling.spp);
    let mut runs = Vec::new();
    for r in 0..replicates {
        let part = Sampling {
            spp: (sampling.spp / replicates).max(1),
            edge_samples: (sampling.edge_samples / replicates).max(1),
            seed: mix(sampling.seed, u64::from(2 + r)),
            ..sampling
        };
        runs.push(replicate(setup, &adjoint, part)?);
        progress(0.2 + 0.8 * f64::from(r + 1) / f64::from(replicates));
    }
    let (parameters, standard_error) = mean(&runs);
    Ok(TargetGradient { loss, parameters, standard_error })
}

/// The mean of replicates and the relative L2 of its standard error.
fn mean<R: Real>(runs: &[Vec<R>]) -> (Vec<R>, Option<f64>) {
    let n = runs.len() as f64;
    let (mut square, mut spread) = (0.0, 0.0);
    let mean = (0..runs[0].len())
        .map(|j| {
            let mean = runs.iter().map(|run| run[j].to_double()).sum::<f64>() / n;
            square += mean * mean;
            spread += runs.iter().map(|run| (run[j].to_double() - mean).powi(2)).sum::<f64>();
            R::of(mean)
        })
        .collect();
    let error = (runs.len() > 1 && square > 0.0).then(|| (spread / (n * (n - 1.0)) / square).sqrt());
    (mean, error)
}

fn replicate<R: Real>(setup: &Setup<'_, R>, adjoint: &[R::Vec3], sampling: Sampling) -> Result<Vec<R>, InvalidField> {
    let camera = &setup.cameras[0];
    let pixels = camera.width as usize * camera.height as usize;
    let edges = Edges::film(camera.width, camera.height);
    let area = pixels.div_ceil(CHUNK);
    let borders = if sampling.estimator == Estimator::Paper { edges.as_slice().len().div_ceil(CHUNK) } else { 0 };
    let (sum, _) = ordered_sum(area + borders, setup.field.parameter_count(), |chunk, sum| {
        let adjoints = if chunk < area {
            area_vjp(setup, adjoint, sampling, chunk * CHUNK..((chunk + 1) * CHUNK).min(pixels))?
        } else {
            boundary_vjp(setup, adjoint, sampling, (chunk - area) * CHUNK, edges.as_slice())?
        };
        adjoints.backward(setup.field, sum);
        Ok(())
    })?;
    Ok(sum)
}

fn area_vjp<R: Real>(
    setup: &Setup<'_, R>,
    adjoint: &[R::Vec3],
    sampling: Sampling,
    pixels: std::ops::Range<usize>,
) -> Result<Adjoints<R>, InvalidField> {
    let (width, spp) = (setup.cameras[0].width as usize, sampling.spp as usize);
    let first = pixels.start;
    let samples: Vec<Sample> = pixels
        .flat_map(|p| pixel_samples(0, (p % width) as u32, (p / width) as u32, sampling.spp, sampling.seed))
        .collect();
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    let weight = R::one() / R::of(f64::from(sampling.spp));
    let delta = |i: usize| adjoint[first + i / spp] * weight;
    let hit_adjoint: Vec<_> = primary.hits.iter().map(|&i| delta(i)).collect();
    let mut shader = vec![R::zero(); setup.shader.parameter_count()];
    let surface = setup.surface_vjp(&samples, &primary, &hit_adjoint, &mut shader);
    let mut out = Adjoints::default();
    for hit in 0..primary.hits.len() {
        out.push(primary.x[hit], surface.alpha[hit], surface.c[hit]);
    }
    if sampling.estimator == Estimator::Paper {
        let scalar: Vec<R> = (0..samples.len()).map(|i| delta(i).dot(setup.excess(primary.radiance[i]))).collect();
        let mut film = vec![[R::zero(); 2]; samples.len()];
        primary.hits.iter().zip(surface.film).for_each(|(&i, f)| film[i] = f);
        setup.warp(&samples, &primary.rays, true).area_vjp(&scalar, &film, &mut out);
    }
    Ok(out)
}

fn boundary_vjp<R: Real>(
    setup: &Setup<'_, R>,
    adjoint: &[R::Vec3],
    sampling: Sampling,
    first: usize,
    edges: &[boundary::Edge],
) -> Result<Adjoints<R>, InvalidField> {
    let count = sampling.edge_samples as usize;
    let edges = &edges[first..(first + CHUNK).min(edges.len())];
    let samples = edge_samples(edges, 0, first, sampling.edge_samples, sampling.seed);
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    let weight = R::one() / R::of(f64::from(sampling.edge_samples));
    let (flux, axis): (Vec<R>, Vec<usize>) = (0..samples.len())
        .map(|i| {
            let edge = &edges[i / count];
            let excess = setup.excess(primary.radiance[i]);
            (edge.gather(|p| adjoint[p].dot(excess)) * weight, edge.axis())
        })
        .unzip();
    let mut out = Adjoints::default();
    setup.warp(&samples, &primary.rays, false).flux_vjp(&flux, &axis, &mut out);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Direction, differentiate};
    use crate::scene::Scene;
    use serde_json::json;
    use std::path::Path;

    fn scene(radius: f64, x: f64) -> Scene {
        let value = json!({
            "camera": {"width": 12, "height": 10, "focal": 20.0, "principal": [6, 5],
                       "eye": [0.4, -0.3, 3.6], "target": [0, 0, 0], "up": [0, 1, 0]},
            "sdf": {"type": "sphere", "center": [x, 0.03, 0], "radius": radius},
            "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2],
                           "lights": [{"type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 1, 1]}]},
            "background": [0.1, 0.2, 0.3]
        });
        Scene::from_value(Path::new("scene.json"), &value).unwrap()
    }

    /// The reverse mode against the forward mode, which is checked against closed forms: Σ (I − target) dI/dθ.
    #[test]
    fn reverse_agrees_with_forward() {
        let (here, there) = (scene(0.7, 0.05), scene(0.78, 0.1));
        let cameras = [here.camera];
        let target = {
            let field = there.sdf.build::<f64>().unwrap();
            let shader = there.shader::<f64>(&*field).unwrap();
            let setup = Setup::new(&*field, &*shader, &cameras, &there.bounds, there.background.into());
            render(&setup, 0, 64, 5, &|_| {}).unwrap().film
        };
        let field = here.sdf.build::<f64>().unwrap();
        let shader = here.shader::<f64>(&*field).unwrap();
        let setup = Setup::new(&*field, &*shader, &cameras, &here.bounds, here.background.into());
        let image = render(&setup, 0, 1024, 6, &|_| {}).unwrap().film;
        let sampling = Sampling { estimator: Estimator::Paper, spp: 256, edge_samples: 256, seed: 1 };
        let reverse = target_gradient(&setup, &target, sampling, &|_| {}).unwrap();
        let directions: Vec<Direction> = [0, 2, 3, 4, 9, 10, 11, 12]
            .into_iter()
            .filter(|j| *j < reverse.parameters.len())
            .map(Direction::Field)
            .collect();
        let forward = differentiate(&setup, &directions, sampling, &|_| {}).unwrap();
        for (direction, derivative) in directions.iter().zip(&forward) {
            let Direction::Field(j) = *direction else { continue };
            let (mut sum, mut scale) = (0.0, 0.0);
            for p in 0..target.pixels.len() {
                for c in 0..3 {
                    let term =
                        f64::from(image.pixels[p][c] - target.pixels[p][c]) * f64::from(derivative.film.pixels[p][c]);
                    sum += term;
                    scale += term.abs();
                }
            }
            let got = reverse.parameters[j];
            assert!((got - sum).abs() < 0.05 * scale, "parameter {j}: reverse {got}, forward {sum}, of {scale}");
        }
    }
}
