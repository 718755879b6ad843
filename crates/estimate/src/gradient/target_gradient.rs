//! The gradient of an image loss by all parameters of the field.

use field::{PartialSum, Real, Vector3};
use film::Film;
use random::Name;
use render::{InvalidField, Scene, render};

use crate::gaussian_samples;
use crate::gradient::replicates::{Image, Replicate, Sampling, lattice, tiles, with_lattice};
use crate::record::{Adjoints, Pass, ordered_sum};
use crate::{Estimator, Filter, SilhouetteMask, Terms};

const TARGET_IMAGE: Name = Name::new("image that gives the adjoints of a target", 2);
const TARGET_SAMPLES: Name = Name::new("samples that a target gradient differentiates", 3);

/// The gradient of the loss ½ Σ (I − target)².
#[derive(Clone, Debug)]
pub struct TargetGradient<R> {
    /// The loss of the image that gave the adjoints.
    pub loss: f64,
    /// The gradient by the parameters of the field.
    pub parameters: Vec<R>,
    /// The estimated standard error: its L2 norm over the parameters, relative to that of the
    /// gradient, from independent replicates; `None` for one replicate or a gradient of zero.
    pub standard_error: Option<f64>,
}

/// The gradient of ½ Σ (I − target)², summed over pixels and channels, for the scene's first
/// camera.
///
/// The image that gives the adjoints I − target and the samples that are differentiated are
/// independent, so their product has no bias. (The estimator may have one of its own.)
/// The same seed gives the same bits on any number of threads.
/// `progress` gets the fraction that is done; several threads call it.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the number of samples per pixel is 0, the scene has no camera, or the target has fewer pixels
/// than the film of the camera.
pub fn target_gradient<R: Real>(
    scene: &Scene<'_, R>,
    target: &Film,
    estimator: &dyn Estimator<R>,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<TargetGradient<R>, InvalidField> {
    let lattice = lattice(scene, estimator, sampling.counts);
    let scene = &with_lattice(scene, lattice.as_ref());
    let image = image(scene, estimator, sampling, &|p| progress(0.2 * p))?;
    let (loss, adjoint) = loss_adjoint::<R>(&image, target);
    let parts = sampling.replicates(estimator.depends_on_seed());
    let camera = &scene.cameras[0];
    let of = |p: &render::Pixel| adjoint[p.y as usize * camera.width as usize + p.x as usize];
    let mut tiles = tiles(camera, parts[0].counts, estimator.memory_factor());
    // The adjoint of a pixel that is equal to its target is zero.
    tiles.iter_mut().for_each(|tile| tile.retain(|p| of(p) != R::Vec3::zero()));
    let mut masks = vec![SilhouetteMask::default(); tiles.len()];
    let mut runs = Vec::new();
    let parameters = scene.field.parameter_count();
    for (r, part) in parts.iter().enumerate() {
        let part = Replicate { stream: part.stream.named(TARGET_SAMPLES), ..*part };
        let (sum, found) = ordered_sum(tiles.len(), parameters, |tile, sum: &mut [R]| {
            let (pixels, mut mask) = (&tiles[tile], masks[tile].clone());
            let record = estimator.record(scene, &part.batch(pixels, Terms::All), &mut mask)?;
            let delta: Vec<R::Vec3> = pixels.iter().map(of).collect();
            let mut adjoints = Adjoints::default();
            let shader = scene.shader;
            let mut ignored = PartialSum::zero(shader.parameter_count(), shader.table());
            record.vjp(scene, &delta, Pass::Sum, &mut ignored, &mut adjoints);
            adjoints.backward(scene.field, sum);
            Ok(mask)
        })?;
        masks = found;
        runs.push(sum);
        progress(0.2 + 0.8 * (r + 1) as f64 / parts.len() as f64);
    }
    let (parameters, standard_error) = mean(&runs);
    Ok(TargetGradient { loss, parameters, standard_error })
}

/// The loss ½ Σ (I − target)², and the adjoint I − target of every pixel.
fn loss_adjoint<R: Real>(image: &Image, target: &Film) -> (f64, Vec<R::Vec3>) {
    let mut loss = 0.0;
    let adjoint = image
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
    (loss, adjoint)
}

/// The image under the filter of the estimator, from samples of its own.
fn image<R: Real>(
    scene: &Scene<'_, R>,
    estimator: &dyn Estimator<R>,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Image, InvalidField> {
    let stream = sampling.stream().named(TARGET_IMAGE);
    let spp = sampling.counts.spp;
    if estimator.filter() == Filter::Box {
        let pixels = render(scene, 0, spp, stream.bits(), progress)?.film.pixels;
        return Ok(pixels.into_iter().map(|p| p.map(f64::from)).collect());
    }
    let camera = &scene.cameras[0];
    let mut pixels = vec![[0.0; 3]; camera.width as usize * camera.height as usize];
    for tile in tiles(camera, sampling.counts, estimator.memory_factor()) {
        let (samples, _) = gaussian_samples::<R>(&tile, spp, stream);
        let radiance = scene.primary(&samples)?.pixel_means(spp);
        for (p, radiance) in tile.iter().zip(radiance) {
            let rgb = R::Vec3::to_array(radiance).map(R::to_double);
            pixels[p.y as usize * camera.width as usize + p.x as usize] = rgb;
        }
    }
    Ok(pixels)
}

/// The mean of replicates, and the L2 norm of its standard error relative to that of the mean.
fn mean<R: Real>(runs: &[Vec<R>]) -> (Vec<R>, Option<f64>) {
    let n = runs.len() as f64;
    let (mut square, mut deviation) = (0.0, 0.0);
    let mean = (0..runs[0].len())
        .map(|j| {
            let mean = runs.iter().map(|run| run[j].to_double()).sum::<f64>() / n;
            square += mean * mean;
            deviation += runs.iter().map(|run| (run[j].to_double() - mean).powi(2)).sum::<f64>();
            R::of(mean)
        })
        .collect();
    let error =
        (runs.len() > 1 && square > 0.0).then(|| (deviation / (n * (n - 1.0)) / square).sqrt());
    (mean, error)
}
