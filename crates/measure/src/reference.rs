//! Reference derivative images under the box filter and the Gaussian filter.
//!
//! Both come from the estimator `contour`, which integrates along the silhouette and needs no warp.

use anyhow::Context;
use serde_json::{Value, json};

use crate::dsdf::{RunDsdf, gradient};
use crate::image::Image;

/// Fine pixels along the side of a pixel, for the Gaussian filter.
const FINE: usize = 8;

/// Reach of the Gaussian on each side of a pixel, in pixels: four standard deviations.
const REACH: usize = 2;

/// Standard deviation of the Gaussian filter, in pixels.
const DEVIATION: f64 = 0.5;

/// The estimators of Gaussian-filtered pixels.
pub const GAUSSIAN: [&str; 3] = ["gaussian", "was", "loubet"];

/// The derivative images of box-filtered pixels, one for each parameter in `wrt`, with 1024 samples
/// per pixel.
///
/// # Errors
/// If `dsdf gradient` fails.
pub fn box_filtered(
    program: &(impl RunDsdf + ?Sized),
    scene: &Value,
    wrt: &[String],
) -> anyhow::Result<Vec<Image>> {
    Ok(gradient(program, scene, wrt, &["--estimator", "contour", "--spp", "1024"])?.images)
}

/// The derivative images of Gaussian-filtered pixels, one for each parameter in `wrt`.
///
/// The contours are integrated on a film with finer pixels and a margin. The filter's weighted sum
/// over the fine pixels then gives the pixels. A fine pixel counts at its centre, an error of
/// 0.3 %.
///
/// # Errors
/// If the scene has no camera, or if `dsdf gradient` fails.
pub fn gaussian_filtered(
    program: &(impl RunDsdf + ?Sized),
    scene: &Value,
    wrt: &[String],
) -> anyhow::Result<Vec<Image>> {
    let mut fine = scene.clone();
    let [width, height] = refine_film(fine.get_mut("camera").context("a camera")?)?;
    let images = gradient(program, &fine, wrt, &["--estimator", "contour", "--spp", "16"])?.images;
    Ok(images.iter().map(|fine| filtered(fine, width, height)).collect())
}

/// Divides the film's pixels and adds the filter's margin; returns the width and height before, in
/// pixels.
fn refine_film(camera: &mut Value) -> anyhow::Result<[usize; 2]> {
    let number =
        |camera: &Value, key: &str| camera[key].as_f64().with_context(|| format!("camera/{key}"));
    let (width, height) = (number(camera, "width")? as usize, number(camera, "height")? as usize);
    let scale = FINE as f64;
    camera["width"] = json!((width + 2 * REACH) * FINE);
    camera["height"] = json!((height + 2 * REACH) * FINE);
    camera["focal"] = json!(number(camera, "focal")? * scale);
    let principal: Vec<f64> = camera["principal"]
        .as_array()
        .context("camera/principal")?
        .iter()
        .filter_map(Value::as_f64)
        .collect();
    camera["principal"] =
        json!([(principal[0] + REACH as f64) * scale, (principal[1] + REACH as f64) * scale]);
    Ok([width, height])
}

/// The Gaussian's weights for the fine pixels along one axis, from `REACH` pixels before a pixel
/// to `REACH` pixels after it.
fn kernel() -> Vec<f64> {
    (0..(2 * REACH + 1) * FINE)
        .map(|i| {
            let off = ((i as f64 + 0.5) / FINE as f64 - REACH as f64 - 0.5) / DEVIATION;
            (-0.5 * off * off).exp() / (DEVIATION * std::f64::consts::TAU.sqrt() * FINE as f64)
        })
        .collect()
}

/// Sums a fine image with margin into `width` × `height` pixels.
fn filtered(fine: &Image, width: usize, height: usize) -> Image {
    let kernel = kernel();
    let mut pixels = Vec::with_capacity(width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let mut sum = [0.0; 3];
        for (j, wy) in kernel.iter().enumerate() {
            let row = (y * FINE + j) * fine.width + x * FINE;
            for (wx, value) in kernel.iter().zip(&fine.pixels[row..row + kernel.len()]) {
                (0..3).for_each(|c| sum[c] += wx * wy * value[c]);
            }
        }
        pixels.push(sum);
    }
    Image { width, pixels }
}
