//! The gradient of an image loss by all parameters of the field, reverse mode.

use field::{Real, Vector3};

use super::image::tiles;
use super::{
    Adjoints, Control, Estimator, Filter, Pass, Pixel, Sampling, Setup, Survey, WarpedArea,
    ordered_sum, render,
};
use crate::InvalidField;
use film::Film;
use random::mix;

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

/// The gradient of ½ Σ (I − target)², summed over pixels and channels, for the setup's first
/// camera.
///
/// The image that gives the adjoints and the samples that are differentiated are independent, so
/// that the product of the two has no bias.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn target_gradient<R: Real>(
    setup: &Setup<'_, R>,
    target: &Film,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<TargetGradient<R>, InvalidField> {
    let image = image(setup, sampling, &|p| progress(0.2 * p))?;
    let mut loss = 0.0;
    let adjoint: Vec<R::Vec3> = image
        .iter()
        .zip(&target.pixels)
        .map(|(image, target)| {
            R::Vec3::from_array(std::array::from_fn(|c| {
                let residual = image[c] - f64::from(target[c]);
                loss += 0.5 * residual * residual;
                R::of(residual)
            }))
        })
        .collect();

    let parts = sampling.replicates();
    let camera = &setup.cameras[0];
    let of = |p: &Pixel| adjoint[p.y as usize * camera.width as usize + p.x as usize];
    // Where the image is as it should be there is nothing to differentiate.
    let mut tiles = tiles(camera.width, camera.height, parts[0], setup.steps);
    tiles.iter_mut().for_each(|tile| tile.retain(|p| of(p) != R::Vec3::zero()));
    let mut surveys = vec![Survey::default(); tiles.len()];
    let mut runs = Vec::new();
    for (r, part) in parts.iter().enumerate() {
        let estimator = part.estimator::<R>();
        let (sum, surveyed) =
            ordered_sum(tiles.len(), setup.field.parameter_count(), |tile, sum: &mut [R]| {
                let (pixels, mut survey) = (&tiles[tile], surveys[tile].clone());
                let record =
                    estimator.record_surveyed(setup, pixels, mix(part.seed, 2), &mut survey)?;
                let delta: Vec<R::Vec3> = pixels.iter().map(of).collect();
                let (mut adjoints, mut ignored) =
                    (Adjoints::default(), vec![R::zero(); setup.shader.parameter_count()]);
                record.vjp(setup, &delta, Pass::Sum, &mut ignored, &mut adjoints);
                adjoints.backward(setup.field, sum);
                Ok(survey)
            })?;
        surveys = surveyed;
        runs.push(sum);
        progress(0.2 + 0.8 * (r + 1) as f64 / parts.len() as f64);
    }
    let (parameters, standard_error) = mean(&runs);
    Ok(TargetGradient { loss, parameters, standard_error })
}

/// The image whose derivative the estimator gives, from samples of its own.
fn image<R: Real>(
    setup: &Setup<'_, R>,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<[f64; 3]>, InvalidField> {
    let seed = mix(sampling.seed, 1);
    if sampling.method.filter() == Filter::Box {
        let pixels = render(setup, 0, sampling.spp, seed, progress)?.film.pixels;
        return Ok(pixels.into_iter().map(|p| p.map(f64::from)).collect());
    }
    let camera = &setup.cameras[0];
    let samples = WarpedArea {
        spp: sampling.spp,
        edge_samples: 1,
        filter: Filter::Gaussian,
        silhouettes: false,
        all_points: false,
        control: Control::Background,
        own_weights: false,
    };
    let mut pixels = vec![[0.0; 3]; camera.width as usize * camera.height as usize];
    for tile in tiles(camera.width, camera.height, sampling, setup.steps) {
        for (p, radiance) in tile.iter().zip(samples.record(setup, &tile, seed)?.radiance) {
            let rgb = R::Vec3::to_array(radiance).map(R::to_double);
            pixels[p.y as usize * camera.width as usize + p.x as usize] = rgb;
        }
    }
    Ok(pixels)
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
    let error =
        (runs.len() > 1 && square > 0.0).then(|| (spread / (n * (n - 1.0)) / square).sqrt());
    (mean, error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Direction, Method, Pixel, differentiate};
    use glam::DVec3;
    use scene::Scene;
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

    /// The reverse mode against the forward mode, which is checked against closed forms: Σ (I −
    /// target) dI/dθ.
    #[test]
    fn reverse_agrees_with_forward() {
        let (here, there) = (scene(0.7, 0.05), scene(0.78, 0.1));
        let cameras = [here.camera];
        let target = {
            let field = there.sdf.build::<f64>().unwrap();
            let shader = there.shader::<f64>(&*field).unwrap();
            let setup =
                Setup::new(&*field, &*shader, &cameras, &there.bounds, there.background.into());
            render(&setup, 0, 64, 5, &|_| {}).unwrap().film
        };
        let field = here.sdf.build::<f64>().unwrap();
        let shader = here.shader::<f64>(&*field).unwrap();
        let setup = Setup::new(&*field, &*shader, &cameras, &here.bounds, here.background.into());
        for (_, method) in Method::ALL.into_iter().filter(|(_, m)| *m != Method::FiniteDifferences)
        {
            transposes(&setup, method);
        }
        let image = render(&setup, 0, 1024, 6, &|_| {}).unwrap().film;
        // Motion along the view has a tenth of noise with the published warp.
        for (method, tolerance) in
            [(Method::Paper, 0.15), (Method::Refined, 0.02), (Method::Band, 0.05)]
        {
            agree(&setup, &image, &target, method, tolerance);
        }
    }

    /// Σ δ_p ∂I_p/∂θ both ways from the same samples: pixel by pixel, and in one sum.
    fn transposes(setup: &Setup<'_, f64>, method: Method) {
        let pixels: Vec<Pixel> =
            (0..120).map(|i| Pixel { camera: 0, x: i % 12, y: i / 12 }).collect();
        let delta: Vec<DVec3> =
            (0..120).map(|i| DVec3::new(0.3, -0.7, 0.2) * f64::from(i % 7) + 0.1).collect();
        for control in [Control::Background, Control::Mean] {
            let record =
                method.estimator(9, 4, control).unwrap().record(setup, &pixels, 3).unwrap();
            let gradient = |delta: &[DVec3], pass| {
                let (mut adjoints, mut shader) =
                    (Adjoints::default(), vec![0.0; setup.shader.parameter_count()]);
                record.vjp(setup, delta, pass, &mut shader, &mut adjoints);
                let mut sum = vec![0.0; setup.field.parameter_count()];
                adjoints.backward(setup.field, &mut sum);
                sum
            };
            let together = gradient(&delta, Pass::Sum);
            let mut apart = vec![0.0; together.len()];
            for p in 0..pixels.len() {
                let mut one = vec![DVec3::ZERO; pixels.len()];
                one[p] = delta[p];
                apart.iter_mut().zip(gradient(&one, Pass::PerPixel)).for_each(|(sum, g)| *sum += g);
            }
            let scale = together.iter().map(|g| g.abs()).fold(0.0, f64::max);
            assert!(scale > 0.1, "{method:?}: {together:?}");
            for (a, b) in together.iter().zip(&apart) {
                assert!((a - b).abs() < 1e-9 * scale, "{method:?}: {together:?} against {apart:?}");
            }
        }
    }

    fn agree(setup: &Setup<'_, f64>, image: &Film, target: &Film, method: Method, tolerance: f64) {
        let sampling = Sampling { method, spp: 256, edge_samples: 256, seed: 1 };
        let reverse = target_gradient(setup, target, sampling, &|_| {}).unwrap();
        let directions: Vec<Direction> = [0, 2, 3, 4, 9, 10, 11, 12]
            .into_iter()
            .filter(|j| *j < reverse.parameters.len())
            .map(Direction::Field)
            .collect();
        let forward = differentiate(setup, &directions, sampling, &|_| {}).unwrap();
        for (direction, derivative) in directions.iter().zip(&forward) {
            let Direction::Field(j) = *direction else { continue };
            let (mut sum, mut scale) = (0.0, 0.0);
            for p in 0..target.pixels.len() {
                for c in 0..3 {
                    let term = f64::from(image.pixels[p][c] - target.pixels[p][c])
                        * f64::from(derivative.film.pixels[p][c]);
                    sum += term;
                    scale += term.abs();
                }
            }
            let got = reverse.parameters[j];
            assert!(
                (got - sum).abs() < tolerance * scale,
                "{method:?}, parameter {j}: reverse {got}, forward {sum}, of {scale}"
            );
        }
    }
}
