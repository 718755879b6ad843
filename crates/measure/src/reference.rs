//! Reference derivative images under either pixel filter.

use anyhow::Context;
use serde_json::{Value, json};

use crate::dsdf::{Image, Run, gradient};

/// Fine pixels along the side of a pixel, for the Gaussian filter.
const FINE: usize = 8;

/// How far the Gaussian is followed, in pixels: four standard deviations.
const REACH: usize = 2;

/// The standard deviation of the Gaussian filter, in pixels.
const DEVIATION: f64 = 0.5;

/// The estimators of Gaussian-filtered pixels.
pub const GAUSSIAN: [&str; 3] = ["gaussian", "was", "loubet"];

/// The derivatives of box-filtered pixels.
pub fn box_filtered(
    program: &(impl Run + ?Sized),
    scene: &Value,
    wrt: &[String],
) -> anyhow::Result<Vec<Image>> {
    Ok(gradient(program, scene, wrt, &["--estimator", "contour", "--spp", "1024"])?.images)
}

/// The derivatives of Gaussian-filtered pixels: contours on a finer and wider film, and the
/// filter's sum over it. A fine pixel stands for its middle, which is right to 0.3 %.
pub fn gaussian_filtered(
    program: &(impl Run + ?Sized),
    scene: &Value,
    wrt: &[String],
) -> anyhow::Result<Vec<Image>> {
    let mut fine = scene.clone();
    let camera = fine.get_mut("camera").context("a camera")?;
    let number =
        |camera: &Value, key: &str| camera[key].as_f64().with_context(|| format!("camera/{key}"));
    let (width, height) = (number(camera, "width")? as usize, number(camera, "height")? as usize);
    let scale = FINE as f64;
    camera["width"] = json!((width + 2 * REACH) * FINE);
    camera["height"] = json!((height + 2 * REACH) * FINE);
    camera["focal"] = json!(number(camera, "focal")? * scale);
    let middle: Vec<f64> = camera["principal"]
        .as_array()
        .context("camera/principal")?
        .iter()
        .filter_map(Value::as_f64)
        .collect();
    camera["principal"] =
        json!([(middle[0] + REACH as f64) * scale, (middle[1] + REACH as f64) * scale]);
    let images = gradient(program, &fine, wrt, &["--estimator", "contour", "--spp", "16"])?.images;
    Ok(images.iter().map(|fine| filtered(fine, width, height)).collect())
}

/// Sums a fine, wide image into pixels.
fn filtered(fine: &Image, width: usize, height: usize) -> Image {
    let side = (2 * REACH + 1) * FINE;
    let kernel: Vec<f64> = (0..side)
        .map(|i| {
            let off = ((i as f64 + 0.5) / FINE as f64 - REACH as f64 - 0.5) / DEVIATION;
            (-0.5 * off * off).exp() / (DEVIATION * std::f64::consts::TAU.sqrt() * FINE as f64)
        })
        .collect();
    let mut pixels = Vec::with_capacity(width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let mut sum = [0.0; 3];
        for (j, wy) in kernel.iter().enumerate() {
            let row = (y * FINE + j) * fine.width + x * FINE;
            for (wx, value) in kernel.iter().zip(&fine.pixels[row..row + side]) {
                (0..3).for_each(|c| sum[c] += wx * wy * value[c]);
            }
        }
        pixels.push(sum);
    }
    Image { width, pixels }
}
