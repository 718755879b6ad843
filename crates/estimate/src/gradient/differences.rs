//! The reference `fd`: finite differences with common random numbers.

use film::Film;

use crate::gradient::derivative_image::Derivative;
use crate::gradient::replicates::{Image, Mean, Sampling};

/// The central difference (I(+h) − I(−h))/2h of two images rendered with the same samples.
///
/// `render` makes the image of the scene whose parameter is changed by ±h, with the given samples.
/// The error is of second order in h = `step`, and of first order in pixels of which a silhouette
/// passes a corner within h. The noise grows as 1/√(h · samples) if silhouettes move by less than
/// the distance between samples. `progress` gets the fraction that is done.
///
/// # Errors
/// The errors of `render`.
///
/// # Panics
/// If the number of samples per pixel is 0.
pub fn finite_difference<E>(
    sampling: Sampling,
    step: f64,
    progress: &(dyn Fn(f64) + Sync),
    render: impl Fn(f64, Sampling) -> Result<Film, E>,
) -> Result<Derivative, E> {
    let parts = sampling.replicates(true);
    let mut images: Vec<Image> = Vec::new();
    let mut size = (0, 0);
    for (i, part) in parts.iter().enumerate() {
        let sampling = part.sampling();
        let (plus, minus) = (render(step, sampling)?, render(-step, sampling)?);
        size = (plus.width, plus.height);
        let slope = |a: &[f32; 3], b: &[f32; 3]| {
            std::array::from_fn(|c| (f64::from(a[c]) - f64::from(b[c])) / (2.0 * step))
        };
        images.push(plus.pixels.iter().zip(&minus.pixels).map(|(a, b)| slope(a, b)).collect());
        progress((i + 1) as f64 / parts.len() as f64);
    }
    let weights: Vec<f64> = parts.iter().map(|part| f64::from(part.counts.spp)).collect();
    let mean = Mean::of(images[0].len(), &weights, |r, p| images[r][p]);
    let standard_error = Mean::standard_error(std::iter::once(&mean), weights.len());
    let film = Film { width: size.0, height: size.1, pixels: mean.pixels };
    Ok(Derivative { film, standard_error })
}
