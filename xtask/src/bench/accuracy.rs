//! The error of a derivative image against contours.

use std::path::Path;

use serde::Serialize;
use sweep::measure::dsdf;
use sweep::measure::image::SquaredError;

use super::scenes::disc;

/// Runs, each with its own seed.
const SEEDS: u32 = 64;

/// The relative L2 error of the disc's derivative image by the radius, at 4 samples per pixel.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Accuracy {
    /// Of the expected image, estimated from the runs.
    bias: f64,
    /// The noise of the mean over the runs.
    noise: f64,
    /// Of one run, root mean square.
    rmse: f64,
}

/// Measures the accuracy and prints it.
pub(crate) fn measure(binary: &Path) -> anyhow::Result<Accuracy> {
    let (scene, wrt) = (disc(128), ["/sdf/radius".to_owned()]);
    let flags = ["--estimator", "contour", "--spp", "1024"];
    let reference = dsdf::gradient(binary, &scene, &wrt, &flags)?.images.remove(0);
    let mut images = Vec::new();
    for seed in 0..SEEDS {
        let flags = ["--spp", "4", "--seed", &seed.to_string()];
        images.push(dsdf::gradient(binary, &scene, &wrt, &flags)?.images.remove(0));
    }
    let error = SquaredError::of(&images.iter().collect::<Vec<_>>(), &reference);
    let relative = |square: f64| square.sqrt() / reference.norm();
    let accuracy = Accuracy {
        bias: relative(error.bias.max(0.0)),
        noise: relative(error.noise),
        rmse: relative(error.run),
    };
    println!(
        "\nThe derivative at 4 samples: bias {:.2} % (the mean of {SEEDS} seeds has {:.2} % of \
         noise), RMSE {:.1} %",
        100.0 * accuracy.bias,
        100.0 * accuracy.noise,
        100.0 * accuracy.rmse
    );
    Ok(accuracy)
}
