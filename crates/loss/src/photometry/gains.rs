//! Exposures of photographs: a factor of the radiance for each view and channel.

use field::BackgroundPerCamera;
use film::Film;
use glam::{DVec3, Vec3};
use optim::{Adam, Group, OptimError};

use crate::photometry::loss::Target;

/// The largest logarithm of a factor: four stops.
const MOST: f64 = 4.0 * std::f64::consts::LN_2;

/// The reason why a saved state was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GainsError {
    /// The optimiser refused it.
    #[error(transparent)]
    Optimiser(#[from] OptimError),
    /// The logarithms are not those of the views.
    #[error("{found} logarithms of exposures, expected {expected} up to 2.8")]
    Count {
        /// The number of saved logarithms.
        found: usize,
        /// The number for these views.
        expected: usize,
    },
}

/// A factor for each view and channel, by which a photograph shows the radiance of the model.
///
/// The mean of the logarithms over the views is 0 in each channel: a factor of all photographs
/// belongs to the radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// Natural logarithms, three for each view.
    logarithms: Vec<f64>,
    adam: Adam<f64>,
}

impl Gains {
    /// Factors of 1 for `views` views.
    pub fn new(views: usize) -> Self {
        let adam = Adam::new(3 * views, vec![Group::new("exposures", 0..3 * views)]);
        Gains { logarithms: vec![0.0; 3 * views], adam }
    }

    /// The factors of all views.
    pub fn factors(&self) -> Vec<Vec3> {
        let of_view = |own: &[f64]| Vec3::from(std::array::from_fn(|c| own[c].exp() as f32));
        self.logarithms.chunks_exact(3).map(of_view).collect()
    }

    /// log₂ of the factors of each view: the exposure in stops.
    pub fn stops(&self) -> Vec<[f64; 3]> {
        let of_view = |own: &[f64]| std::array::from_fn(|c| own[c] / std::f64::consts::LN_2);
        self.logarithms.chunks_exact(3).map(of_view).collect()
    }

    /// One step of the optimiser against the adjoints of the natural logarithms of all factors.
    ///
    /// # Errors
    /// If an adjoint is not finite. Nothing has changed then.
    pub fn step(&mut self, adjoints: &[DVec3], rate: f64) -> Result<(), OptimError> {
        let gradient: Vec<f64> = adjoints.iter().flat_map(|adjoint| adjoint.to_array()).collect();
        self.adam.step(&mut self.logarithms, &gradient, rate)?;
        let views = (self.logarithms.len() / 3) as f64;
        for c in 0..3 {
            let channel = || (c..self.logarithms.len()).step_by(3);
            let mean = channel().map(|i| self.logarithms[i]).sum::<f64>() / views;
            for i in channel() {
                self.logarithms[i] = (self.logarithms[i] - mean).clamp(-MOST, MOST);
            }
        }
        Ok(())
    }

    /// The logarithms, the running means of the gradient and of its square, and the number of
    /// steps: the state from which a run can continue.
    pub fn state(&self) -> (&[f64], &[f64], &[f64], u64) {
        let (first, second, steps) = self.adam.state();
        (&self.logarithms, first, second, steps)
    }

    /// Restores the state that [`state`](Self::state) returned.
    ///
    /// # Errors
    /// If a length is wrong, or a number is not one that a run can produce.
    pub fn restore(
        &mut self,
        logarithms: &[f64],
        first: &[f64],
        second: &[f64],
        steps: u64,
    ) -> Result<(), GainsError> {
        let (found, expected) = (logarithms.len(), self.logarithms.len());
        if found != expected || logarithms.iter().any(|v| v.is_nan() || v.abs() > MOST) {
            return Err(GainsError::Count { found, expected });
        }
        self.adam.restore(first, second, steps)?;
        self.logarithms.copy_from_slice(logarithms);
        Ok(())
    }
}

/// The backgrounds that show these colours after the factors of their views; `None` without colours
/// or factors.
pub fn without_gains(
    colors: Option<&BackgroundPerCamera<f32>>,
    factors: &[Vec3],
) -> Option<BackgroundPerCamera<f32>> {
    let colors = colors.filter(|_| !factors.is_empty())?;
    let divided = colors.0.iter().zip(factors).map(|(color, factor)| *color / *factor);
    Some(BackgroundPerCamera(divided.collect()))
}

/// Steps of [`gain_between`]: each removes most of the weight of outliers.
const STEPS: usize = 12;

/// The factors of the channels by which a photograph shows `image` with the least photometric loss.
/// `used` has one flag for each pixel, row-major.
///
/// Iteratively reweighted least squares (Holland and Welsch, "Robust regression using iteratively
/// reweighted least-squares", 1977): pixels that the image does not explain count little. A black
/// channel has the factor 1.
pub fn gain_between(image: &Film, photograph: &Film, used: impl IntoIterator<Item = bool>) -> Vec3 {
    let size @ [width, _] = [photograph.width, photograph.height];
    let pairs: Vec<([f32; 3], Target)> = (0..)
        .zip(used)
        .zip(&image.pixels)
        .filter(|((_, used), _)| *used)
        .map(|((i, _), seen)| {
            let at = |x, y| photograph.at(x, y);
            (*seen, Target::of(size, at, i % width, i / width))
        })
        .collect();
    let mut gain = Vec3::ONE;
    for _ in 0..STEPS {
        let (mut product, mut square) = (DVec3::ZERO, DVec3::ZERO);
        for (seen, target) in &pairs {
            let shown = Vec3::from(*seen) * gain;
            let weight = target.weights(shown.into());
            for c in 0..3 {
                let [w, l, i] = [weight[c], seen[c], target.radiance[c]].map(f64::from);
                product[c] += w * l * i;
                square[c] += w * l * l;
            }
        }
        let next = |c: usize| if square[c] > 0.0 { product[c] / square[c] } else { 1.0 };
        let least = (-MOST).exp();
        gain = Vec3::from([0, 1, 2].map(|c| next(c).clamp(least, MOST.exp()) as f32));
    }
    gain
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use random::{Name, Stream};

    #[test]
    fn factors_have_the_mean_one_and_descend() {
        let mut gains = Gains::new(2);
        // The first photograph is brighter than the model shows it.
        for _ in 0..10 {
            gains.step(&[DVec3::new(-1.0, -1.0, 0.0), DVec3::ZERO], 0.05).unwrap();
        }
        let factors = gains.factors();
        assert!(factors[0].x > 1.1 && factors[1].x < 0.9, "{factors:?}");
        assert_relative_eq!(factors[0].x * factors[1].x, 1.0, epsilon = 1e-6);
        assert_eq!((factors[0].z, gains.stops()[1][2]), (1.0, 0.0));
        let (logarithms, first, second, steps) = gains.state();
        let mut restored = Gains::new(2);
        restored.restore(logarithms, first, second, steps).unwrap();
        assert_eq!(restored, gains);
        let wrong = restored.restore(&[9.0; 6], &[0.0; 6], &[0.0; 6], 0);
        assert_eq!(wrong, Err(GainsError::Count { found: 6, expected: 6 }));
        assert!(gains.step(&[DVec3::NAN, DVec3::ZERO], 0.1).is_err());
    }

    #[test]
    fn the_factor_between_images_is_found_though_a_quarter_differs() {
        let stream = Stream::of_seed(1).named(Name::other("exposures"));
        let pixel =
            |i: u64| std::array::from_fn(|c| 0.05 + 0.5 * stream.at(i).at(c as u64).unit() as f32);
        let image = Film { width: 20, height: 20, pixels: (0..400).map(pixel).collect() };
        let shown = |(i, p): (usize, &[f32; 3])| match i % 4 {
            0 => [0.9, 0.0, 0.4],
            _ => [p[0] * 1.5, p[1] * 0.7, p[2]],
        };
        let pixels = image.pixels.iter().enumerate().map(shown).collect();
        let photograph = Film { pixels, ..image.clone() };
        let gain = gain_between(&image, &photograph, [true; 400]);
        for (found, expected) in gain.to_array().into_iter().zip([1.5, 0.7, 1.0]) {
            assert_relative_eq!(found, expected, max_relative = 0.1);
        }
        // The pixels that differ are left out.
        let gain = gain_between(&image, &photograph, (0..400).map(|i| i % 4 != 0));
        assert_relative_eq!(gain, Vec3::new(1.5, 0.7, 1.0), max_relative = 1e-4);
        let black = gain_between(&Film::new(20, 20), &photograph, [true; 400]);
        assert_eq!(black, Vec3::ONE);
    }

    #[test]
    fn backgrounds_show_their_colours_after_the_factors() {
        let colors = BackgroundPerCamera(vec![Vec3::new(0.2, 0.4, 0.6), Vec3::ONE]);
        let factors = [Vec3::new(2.0, 1.0, 0.5), Vec3::ONE];
        let divided = without_gains(Some(&colors), &factors).unwrap();
        assert_eq!(without_gains(Some(&colors), &[]), None);
        assert_eq!(divided.0, [Vec3::new(0.1, 0.4, 1.2), Vec3::ONE]);
    }
}
