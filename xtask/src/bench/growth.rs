//! The growth of a derivative image's time with samples, pixels, points and network size.

use std::path::Path;

use serde::Serialize;

use super::programs::best;
use super::scenes::{disc, network};

/// The power law of time in one quantity.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Growth {
    /// The quantity.
    with: &'static str,
    /// The values of the quantity.
    values: Vec<f64>,
    /// The seconds at these values.
    seconds: Vec<f64>,
    /// The slope of the logarithms, by least squares.
    exponent: f64,
}

impl Growth {
    /// Fits the exponent and prints it.
    fn new(with: &'static str, values: Vec<f64>, seconds: Vec<f64>) -> Self {
        let exponent = slope(&values, &seconds);
        println!("| {with} | {exponent:.2} |");
        Growth { with, values, seconds, exponent }
    }
}

/// Options of the disc that vary: name, values, option. The disc has 64 × 64 pixels.
const OPTIONS: [(&str, &[u32], &[&str], &str); 3] = [
    ("samples a pixel", &[16, 64, 256, 1024], &[], "--spp"),
    ("N, points along a ray (paper)", &[22, 44, 88, 176], PAPER, "--steps"),
    ("k, points with a weight (paper)", &[3, 6, 12, 22], PAPER, "--top-k"),
];

/// The options of the published estimator at 16 samples per pixel.
const PAPER: &[&str] = &["--spp", "16", "--estimator", "paper"];

/// Networks that vary: name, `[width, hidden layers]`, and the index of the quantity.
const NETWORKS: [(&str, &[[u32; 2]], usize); 2] = [
    ("width of a network of 3 layers", &[[32, 3], [64, 3], [128, 3], [256, 3]], 0),
    ("hidden layers of 64", &[[64, 2], [64, 4], [64, 8]], 1),
];

/// Measures all quantities and prints their exponents.
pub(crate) fn measure(binary: &Path) -> anyhow::Result<Vec<Growth>> {
    println!("\n| seconds of a gradient grow with | as its power |\n|---|---|");
    let folder = tempfile::tempdir()?;
    let timer = Timer { binary, folder: folder.path() };
    let mut all = vec![timer.pixels(&[64, 128, 256, 512])?];
    for (with, values, base, option) in OPTIONS {
        all.push(timer.option(with, values, base, option)?);
    }
    for (with, shapes, index) in NETWORKS {
        all.push(timer.network(with, shapes, index)?);
    }
    Ok(all)
}

/// The program, and a folder for scenes and outputs.
struct Timer<'a> {
    /// The program `dsdf`.
    binary: &'a Path,
    folder: &'a Path,
}

impl Timer<'_> {
    /// Seconds of a derivative image of a scene file.
    fn seconds(&self, scene: &str, flags: &[&str]) -> anyhow::Result<f64> {
        let out = self.folder.join("out.npy").to_string_lossy().into_owned();
        let arguments = [&["gradient", scene, "-o", &out], flags].concat();
        best(self.binary, &arguments).map(|(seconds, _)| seconds)
    }

    /// Seconds of the disc's derivative image by the radius, `size` × `size` pixels.
    fn disc_seconds(&self, size: u32, flags: &[&str]) -> anyhow::Result<f64> {
        let scene = self.folder.join("scene.json");
        std::fs::write(&scene, disc(size).to_string())?;
        let by = ["--wrt", "/sdf/radius"];
        self.seconds(&scene.to_string_lossy(), &[&by, flags].concat())
    }

    /// Growth with the number of pixels.
    fn pixels(&self, sizes: &[u32]) -> anyhow::Result<Growth> {
        let seconds = sizes.iter().map(|size| self.disc_seconds(*size, &["--spp", "16"]));
        let seconds = seconds.collect::<anyhow::Result<_>>()?;
        let pixels = sizes.iter().map(|size| f64::from(size * size)).collect();
        Ok(Growth::new("pixels", pixels, seconds))
    }

    /// Growth with the value of an option, beside the options `base`.
    fn option(
        &self,
        with: &'static str,
        values: &[u32],
        base: &[&str],
        option: &str,
    ) -> anyhow::Result<Growth> {
        let seconds =
            |value: &u32| self.disc_seconds(64, &[base, &[option, &value.to_string()]].concat());
        let seconds = values.iter().map(seconds).collect::<anyhow::Result<_>>()?;
        Ok(Growth::new(with, values.iter().map(|v| f64::from(*v)).collect(), seconds))
    }

    /// Growth with the width or the number of layers of a network. The derivative image is along a
    /// random direction of its weights.
    fn network(
        &self,
        with: &'static str,
        shapes: &[[u32; 2]],
        index: usize,
    ) -> anyhow::Result<Growth> {
        let flags = ["--wrt", "/sdf/weights/0", "--spp", "16", "--precision", "f32"];
        let seconds = |shape: &[u32; 2]| {
            // A direction in the space of all weights has a number for each coefficient of a grid, too.
            let scene = network(self.binary, self.folder, 32, *shape, &["--grid", "none"])?;
            self.seconds(&scene, &flags)
        };
        let seconds = shapes.iter().map(seconds).collect::<anyhow::Result<_>>()?;
        let values = shapes.iter().map(|shape| f64::from(shape[index])).collect();
        Ok(Growth::new(with, values, seconds))
    }
}

/// The least-squares slope of ln y over ln x.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) =
        (x.iter().map(|v| v.ln()).collect(), y.iter().map(|v| v.ln()).collect());
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum();
    covariance / x.iter().map(|x| (x - mx) * (x - mx)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slope_is_the_exponent_of_a_power_law() {
        let x = [1.0, 2.0, 5.0, 9.0];
        assert!((slope(&x, &x.map(|x: f64| 3.0 * x.powf(1.3))) - 1.3).abs() < 1e-12);
    }
}
