//! Derivative images, and their distance to a reference.

/// An image of three channels.
#[derive(Clone, Debug)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// The pixels, row-major, rows top to bottom.
    pub pixels: Vec<[f64; 3]>,
}

impl Image {
    /// The mean of images of one size.
    fn mean(images: &[&Image]) -> Image {
        let share = 1.0 / images.len() as f64;
        let pixel = |p: usize| {
            std::array::from_fn(|c| images.iter().map(|i| i.pixels[p][c]).sum::<f64>() * share)
        };
        Image { width: images[0].width, pixels: (0..images[0].pixels.len()).map(pixel).collect() }
    }

    /// The L2 norm over pixels and channels.
    pub fn norm(&self) -> f64 {
        self.pixels.iter().flatten().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// The L2 distance to an image of the same size.
    pub fn distance(&self, other: &Image) -> f64 {
        let pairs = self.pixels.iter().flatten().zip(other.pixels.iter().flatten());
        pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    }
}

/// The squared L2 error of runs with different seeds, split into bias and noise.
#[derive(Debug)]
pub struct SquaredError {
    /// The squared distance of one run to the reference, mean over the runs.
    pub run: f64,
    /// The squared distance of the expected image to the reference, estimated without bias. It is
    /// negative if the noise of the mean is larger than the measured distance.
    pub bias: f64,
    /// The expected squared distance of the mean over these runs to the expected image, from the
    /// spread of the runs.
    pub noise: f64,
}

impl SquaredError {
    /// The split for two or more runs of the same image.
    ///
    /// # Panics
    /// If there are no runs.
    pub fn of(runs: &[&Image], reference: &Image) -> Self {
        let (n, mean) = (runs.len() as f64, Image::mean(runs));
        let mean_square =
            |to: &Image| runs.iter().map(|run| run.distance(to).powi(2)).sum::<f64>() / n;
        let noise = mean_square(&mean) / (n - 1.0);
        // The squared distance of the mean contains the noise of the mean.
        let bias = mean.distance(reference).powi(2) - noise;
        SquaredError { run: mean_square(reference), bias, noise }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_is_split_into_bias_and_noise() {
        let image = |v: f64| Image { width: 1, pixels: vec![[v, 0.0, 0.0]] };
        let (low, high) = (image(2.0), image(4.0));
        let error = SquaredError::of(&[&low, &high], &image(0.0));
        // The mean is 3; its variance from two runs at distance 1 is 1.
        assert_eq!((error.run, error.bias, error.noise), (10.0, 8.0, 1.0));
    }
}
