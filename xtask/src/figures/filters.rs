//! Figure 1 of the supplement: the variance that a Gaussian filter has inside an object, pixel by
//! pixel.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

use measure::dsdf::{Image, gradient, scene};
use measure::reference::box_filtered;

const SEEDS: u32 = 32;
const SPP: &str = "16";
const SCENES: [&str; 3] = ["disc.constant", "disc.lambert", "torus.constant"];
const ESTIMATORS: [&str; 3] = ["gaussian", "paper", "refined"];
const MORE: u32 = 3;
const ZOOM: u32 = 5;

pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut table = format!(
        "Variance of one pixel's derivative at {SPP} samples a pixel, mean over pixels, in units of the derivative image's mean square; {SEEDS} seeds.\n\n\
         | scene | by | estimator | pixels inside | pixels with a silhouette |\n|---|---|---|---|---|\n"
    );
    let mut csv = String::from("scene,wrt,estimator,interior_variance,silhouette_variance\n");
    for name in SCENES {
        eprintln!("{name}");
        let scene = magnified(scene(name)?)?;
        let wrt =
            vec![if name.starts_with("torus") { "/sdf/major" } else { "/sdf/radius" }.to_owned()];
        let reference = box_filtered(binary, &scene, &wrt)?.remove(0);
        let coverage = mask(&reference, binary, &scene)?;
        let scale = reference.norm().powi(2) / reference.pixels.len() as f64;
        let mut variances = Vec::new();
        for estimator in ESTIMATORS {
            let runs: anyhow::Result<Vec<Image>> = (0..SEEDS)
                .map(|seed| {
                    let seed = seed.to_string();
                    let flags = ["--estimator", estimator, "--spp", SPP, "--seed", &seed];
                    Ok(gradient(binary, &scene, &wrt, &flags)?.images.remove(0))
                })
                .collect();
            let variance: Vec<f64> = variance(&runs?).into_iter().map(|v| v / scale).collect();
            let mean = |kind: Kind| {
                let own: Vec<f64> = variance
                    .iter()
                    .zip(&coverage)
                    .filter(|(_, k)| **k == kind)
                    .map(|(v, _)| *v)
                    .collect();
                own.iter().fold(0.0, |sum, v| sum + v) / own.len().max(1) as f64
            };
            let (inside, edge) = (mean(Kind::Inside), mean(Kind::Silhouette));
            let _ = writeln!(
                table,
                "| {name} | {} | {estimator} | {inside:.3e} | {edge:.3e} |",
                wrt[0]
            );
            let _ = writeln!(csv, "{name},{},{estimator},{inside:e},{edge:e}", wrt[0]);
            variances.push(variance);
        }
        let width = reference.width;
        picture(&variances, width).save(folder.join(format!("{name}.png")))?;
    }
    super::write(folder, "filters.csv", csv)?;
    super::write(folder, "filters.md", table)
}

/// The scene on a film with more pixels, so that there are some far from silhouettes.
fn magnified(mut scene: Value) -> anyhow::Result<Value> {
    let camera = scene.get_mut("camera").context("a camera")?;
    for key in ["width", "height", "focal"] {
        camera[key] = json!(camera[key].as_f64().context(key)? as u32 * MORE);
    }
    let middle = camera["principal"].as_array_mut().context("camera/principal")?;
    middle.iter_mut().for_each(|v| *v = json!(v.as_f64().unwrap_or_default() * f64::from(MORE)));
    Ok(scene)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Inside,
    Silhouette,
    Outside,
}

/// What each pixel is: a silhouette crosses it, or one passes within two pixels, or neither and it
/// is covered or not.
///
/// The derivative by a shift of the whole background tells coverage.
fn mask(reference: &Image, binary: &Path, scene: &Value) -> anyhow::Result<Vec<Kind>> {
    let background = vec!["/background/0".to_owned()];
    let seen = gradient(binary, scene, &background, &["--estimator", "contour", "--spp", "256"])?
        .images
        .remove(0);
    let (width, height) =
        (reference.width as i64, (reference.pixels.len() / reference.width) as i64);
    let kind = |x: i64, y: i64| {
        let value = seen.pixels[(y * width + x) as usize][0];
        if value < 1e-9 {
            Kind::Inside
        } else if value > 1.0 - 1e-9 {
            Kind::Outside
        } else {
            Kind::Silhouette
        }
    };
    // A Gaussian reaches two pixels: inside is what is further from silhouettes than that.
    let near = |x: i64, y: i64| {
        let around = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (x + i, y + j)));
        around
            .filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y))
            .any(|(x, y)| kind(x, y) == Kind::Silhouette)
    };
    let each = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Ok(each
        .map(|(x, y)| match kind(x, y) {
            Kind::Inside if near(x, y) => Kind::Outside,
            kind => kind,
        })
        .collect())
}

/// The variance of every pixel, mean over channels.
fn variance(runs: &[Image]) -> Vec<f64> {
    let n = runs.len() as f64;
    (0..runs[0].pixels.len())
        .map(|p| {
            (0..3)
                .map(|c| {
                    let mean = runs.iter().map(|r| r.pixels[p][c]).sum::<f64>() / n;
                    runs.iter().map(|r| (r.pixels[p][c] - mean).powi(2)).sum::<f64>()
                        / (n - 1.0)
                        / 3.0
                })
                .sum()
        })
        .collect()
}

/// Variance images side by side, on one logarithmic scale of six decades.
fn picture(variances: &[Vec<f64>], width: usize) -> RgbImage {
    let height = variances[0].len() / width;
    let largest = variances.iter().flatten().copied().fold(1e-30, f64::max);
    let mut out =
        RgbImage::new((variances.len() * (width + 1)) as u32 * ZOOM, height as u32 * ZOOM);
    for (x, y, pixel) in out.enumerate_pixels_mut() {
        let (x, y) = ((x / ZOOM) as usize, (y / ZOOM) as usize);
        let (panel, x) = (x / (width + 1), x % (width + 1));
        *pixel = if x == width {
            Rgb([255; 3])
        } else {
            let level = 1.0 + (variances[panel][y * width + x] / largest).max(1e-30).log10() / 6.0;
            let level = level.clamp(0.0, 1.0);
            Rgb([level, level * level, (level * 4.0).min(1.0) * 0.3].map(|v| (255.0 * v) as u8))
        };
    }
    out
}
