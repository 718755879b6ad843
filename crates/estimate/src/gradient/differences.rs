//! The reference `fd`: finite differences with common random numbers.

use film::Film;

use crate::gradient::derivative_image::Derivative;
use crate::gradient::replicates::{Image, Mean, Sampling};

/// The largest number of times that a step is halved.
const HALVINGS: u32 = 8;

/// The image changes on one side only if it changes this many times as much there.
const ONE_SIDED: f64 = 2.0;

/// The difference of the two changes must have this many standard errors.
const STANDARD_ERRORS: f64 = 5.0;

/// The central difference of an image.
#[derive(Clone, Debug)]
pub struct Difference {
    /// The derivative.
    pub derivative: Derivative,
    /// The step h in units of the parameter: that of the call, or a part of it.
    pub step: f64,
    /// Whether the image changes more than twice as much on one side of the parameter as on the
    /// other with the smallest step, too. The derivative may not exist then.
    pub is_one_sided: bool,
}

/// The central difference (I(+h) − I(−h))/2h of two images rendered with the same samples.
///
/// The step h is `step`. A wall thinner than that vanishes on one side of the parameter, and the
/// difference is then that of another scene: where I(+h) − I(0) and I(0) − I(−h) have L1 norms that
/// differ by more than a factor of 2 and by more than noise, the step is halved, up to eight times.
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
) -> Result<Difference, E> {
    let parts = sampling.replicates(true);
    let at = |offset: f64, part: usize| render(offset, parts[part].sampling());
    let middle = at(0.0, 0)?;
    let (mut step, mut halvings) = (step, 0);
    let (mut ends, is_one_sided) = loop {
        let ends = (at(step, 0)?, at(-step, 0)?);
        let is_one_sided = is_one_sided(&ends.0, &middle, &ends.1);
        if !is_one_sided || halvings == HALVINGS {
            break (ends, is_one_sided);
        }
        (step, halvings) = (step / 2.0, halvings + 1);
    };
    let mut images: Vec<Image> = Vec::new();
    for part in 0..parts.len() {
        if part > 0 {
            ends = (at(step, part)?, at(-step, part)?);
        }
        let slope = |a: &[f32; 3], b: &[f32; 3]| {
            std::array::from_fn(|c| (f64::from(a[c]) - f64::from(b[c])) / (2.0 * step))
        };
        images.push(ends.0.pixels.iter().zip(&ends.1.pixels).map(|(a, b)| slope(a, b)).collect());
        progress((part + 1) as f64 / parts.len() as f64);
    }
    let weights: Vec<f64> = parts.iter().map(|part| f64::from(part.counts.spp)).collect();
    let mean = Mean::of(images[0].len(), &weights, |r, p| images[r][p]);
    let standard_error = Mean::standard_error(std::iter::once(&mean), weights.len());
    let film = Film { width: middle.width, height: middle.height, pixels: mean.pixels };
    Ok(Difference { derivative: Derivative { film, standard_error }, step, is_one_sided })
}

/// Whether an image changes much more from `middle` to one of the others than to the other one.
///
/// If samples change independently of each other, the variance of the L1 norm of a change is at
/// most the sum of its squares.
fn is_one_sided(plus: &Film, middle: &Film, minus: &Film) -> bool {
    let change = |film: &Film| {
        let both = film.pixels.iter().zip(&middle.pixels);
        let values = both.flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c] - b[c])));
        values.fold((0.0, 0.0), |(sum, squares), v| (sum + v.abs(), squares + v * v))
    };
    let ((up, up_squares), (down, down_squares)) = (change(plus), change(minus));
    let noise = STANDARD_ERRORS * (up_squares + down_squares).sqrt();
    up.max(down) > ONE_SIDED * up.min(down) && (up - down).abs() > noise
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SampleCounts;

    /// The image of a wall in front of another one; each pixel is the share of it that is covered.
    fn film(columns: usize, at: impl Fn(usize) -> f64) -> Film {
        let pixels = (0..columns * 64).map(|i| [at(i % columns) as f32; 3]).collect();
        Film { width: columns as u32, height: 64, pixels }
    }

    fn difference(thickness: f64, step: f64) -> Difference {
        let sampling = Sampling { counts: SampleCounts { spp: 4, edge_samples: 4 }, seed: 1 };
        let image = |offset: f64, _| {
            // A wall of this thickness covers the whole film, and its edge is at the column 8.
            let is_there = thickness + offset > 0.0;
            let covered = |column: usize| (8.0 + offset - column as f64).clamp(0.0, 1.0);
            Ok::<_, ()>(film(16, |c| if is_there { covered(c) } else { 0.0 }))
        };
        finite_difference(sampling, step, &|_| {}, image).unwrap()
    }

    #[test]
    fn a_wall_that_the_step_passes_through_halves_the_step() {
        let thick = difference(1.0, 0.1);
        assert_eq!((thick.step, thick.is_one_sided), (0.1, false));
        let thin = difference(0.02, 0.1);
        assert_eq!((thin.step, thin.is_one_sided), (0.0125, false));
        let sum = |d: &Difference| d.derivative.film.pixels.iter().map(|p| p[0]).sum::<f32>();
        approx::assert_relative_eq!(sum(&thin), sum(&thick), max_relative = 1e-3);
        approx::assert_relative_eq!(sum(&thin), 64.0, max_relative = 1e-3);
        // No step is small enough.
        let gone = difference(1e-9, 0.1);
        assert_eq!((gone.step, gone.is_one_sided), (0.1 / 256.0, true));
    }
}
