//! Reference derivative images under the box filter and the Gaussian filter.
//!
//! Both come from the estimator `contour`, which integrates along the silhouette and needs no warp.

use serde_json::{Value, json};

use crate::error::Error;
use crate::measure::dsdf::{RunDsdf, gradient};
use crate::measure::image::Image;

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
) -> Result<Vec<Image>, Error> {
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
) -> Result<Vec<Image>, Error> {
    let mut fine = scene.clone();
    let [width, height] =
        refine_film(fine.get_mut("camera").ok_or_else(Error::lacks("a camera"))?)?;
    let images = gradient(program, &fine, wrt, &["--estimator", "contour", "--spp", "16"])?.images;
    Ok(images.iter().map(|fine| filtered(fine, width, height)).collect())
}

/// Divides the film's pixels and adds the filter's margin; returns the width and height before, in
/// pixels.
fn refine_film(camera: &mut Value) -> Result<[usize; 2], Error> {
    let number = |camera: &Value, key: &str| {
        camera[key].as_f64().ok_or_else(|| Error::content(format!("camera/{key}")))
    };
    let (width, height) = (number(camera, "width")? as usize, number(camera, "height")? as usize);
    let scale = FINE as f64;
    camera["width"] = json!((width + 2 * REACH) * FINE);
    camera["height"] = json!((height + 2 * REACH) * FINE);
    // One focal length, or one for each axis.
    let focal = pair(camera, "focal").or_else(|_| number(camera, "focal").map(|f| [f, f]))?;
    camera["focal"] = json!(focal.map(|f| f * scale));
    let principal = pair(camera, "principal")?;
    camera["principal"] = json!(principal.map(|c| (c + REACH as f64) * scale));
    Ok([width, height])
}

/// A pair of numbers of the camera.
fn pair(camera: &Value, key: &str) -> Result<[f64; 2], Error> {
    let at = |i: usize| {
        camera[key][i].as_f64().ok_or_else(|| Error::content(format!("camera/{key}/{i}")))
    };
    Ok([at(0)?, at(1)?])
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_with_one_focal_length_and_with_two_are_refined() {
        for focal in [json!(24.0), json!([24.0, 24.0])] {
            let mut camera =
                json!({"width": 4, "height": 3, "focal": focal, "principal": [2.0, 1.5]});
            assert_eq!(refine_film(&mut camera).unwrap(), [4, 3]);
            let fine = json!({
                "width": 64, "height": 56, "focal": [192.0, 192.0], "principal": [32.0, 28.0]
            });
            assert_eq!(camera, fine);
        }
        let mut camera = json!({"width": 4, "height": 3, "focal": "wide", "principal": [2, 1]});
        assert_eq!(refine_film(&mut camera).unwrap_err().to_string(), "camera/focal");
    }
}
