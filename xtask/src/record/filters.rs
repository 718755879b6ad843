//! The variance of derivative images inside an object with a Gaussian filter, by pixel.
//!
//! It is figure 1 of the supplementary material to S. Bangaru et al., "Differentiable Rendering of
//! Neural SDFs through Reparameterization", SIGGRAPH Asia 2022.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use sweep::measure::dsdf::gradient;
use sweep::measure::image::Image;
use sweep::measure::reference::box_filtered;
use sweep::measure::suite::scene;

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows, provenance};
use crate::output::write;

/// Runs of every estimator.
const SEEDS: u32 = 32;

/// Samples per pixel.
const SPP: &str = "16";

/// Scenes of the suite.
const SCENES: [&str; 3] = ["disc.constant", "disc.lambert", "torus.constant"];
/// One Gaussian-filtered estimator, and two with a box filter.
const ESTIMATORS: [&str; 3] = ["gaussian", "paper", "refined"];

/// Factor of the film's width and height over those of the suite.
const MAGNIFIED: u32 = 3;

/// Width and height of a film pixel in the pictures, in pixels.
const ZOOM: u32 = 5;

/// Reach of the Gaussian filter, in pixels.
const REACH: i64 = 2;

/// Variances of derivative images with two filters.
pub(crate) struct Filters;

impl Measurement for Filters {
    fn name(&self) -> &'static str {
        "filters"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "crates/sweep/src/measure/", "tests/gradients/"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |name: &str| {
            let command = format!(
                "dsdf gradient SCENE --wrt {} --estimator E --spp {SPP} --seed S, where SCENE is \
                 tests/gradients/{name}.json with {MAGNIFIED} times the width and height",
                parameter(name)
            );
            Planned::new(name, command).seeds((0..SEEDS).map(u64::from))
        };
        Ok(SCENES.into_iter().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let name = &row.name;
        let scene = VarianceScene::new(bench.program, name)?;
        let (mut csv, mut variances, mut means) = (String::new(), Vec::new(), Vec::new());
        for estimator in ESTIMATORS {
            let variance = scene.variance(bench.program, estimator)?;
            let inside = scene.mean(&variance, PixelKind::Inside);
            let edge = scene.mean(&variance, PixelKind::Silhouette);
            let _ = writeln!(csv, "{name},{},{estimator},{inside:e},{edge:e}", scene.wrt[0]);
            means.push([inside, edge]);
            variances.push(variance);
        }
        let picture = picture(&variances, scene.reference.width);
        picture.save(bench.folder.join(format!("{name}.png")))?;
        Ok(json!({ "csv": csv, "variances": means }))
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let plan = self.plan()?;
        let mut table = format!(
            "Variance of one pixel's derivative at {SPP} samples a pixel, mean over pixels, in \
             units of the derivative image's mean square; {SEEDS} seeds.\n\n\
             | scene | by | estimator | pixels inside | pixels with a silhouette |\n\
             |---|---|---|---|---|\n"
        );
        for (name, row) in rows.in_order(&plan) {
            let means: Vec<[f64; 2]> = serde_json::from_value(row.values["variances"].clone())?;
            for (estimator, [inside, edge]) in ESTIMATORS.iter().zip(means) {
                let wrt = parameter(name);
                let _ =
                    writeln!(table, "| {name} | {wrt} | {estimator} | {inside:.3e} | {edge:.3e} |");
            }
        }
        let header = "scene,wrt,estimator,interior_variance,silhouette_variance\n";
        write(folder, "filters.csv", rows.csv(&plan, header))?;
        write(folder, "filters.md", table + "\n" + &provenance(rows) + "\n")
    }
}

/// The parameter by which the images of a scene are differentiated.
fn parameter(scene: &str) -> &'static str {
    if scene.starts_with("torus") { "/sdf/major" } else { "/sdf/radius" }
}

/// A magnified scene with its reference image and its pixels' kinds.
struct VarianceScene {
    /// The scene with more pixels.
    scene: Value,
    /// One parameter.
    wrt: Vec<String>,
    /// The derivative image by contours, under the box filter.
    reference: Image,
    /// One for each pixel.
    kinds: Vec<PixelKind>,
}

impl VarianceScene {
    /// Computes the reference and the pixels' kinds of a scene of the suite.
    fn new(binary: &Path, name: &str) -> anyhow::Result<Self> {
        let scene = magnified(scene(name)?)?;
        let wrt = vec![parameter(name).to_owned()];
        let reference = box_filtered(binary, &scene, &wrt)?.remove(0);
        let kinds = pixel_kinds(&reference, binary, &scene)?;
        Ok(VarianceScene { scene, wrt, reference, kinds })
    }

    /// The variance of every pixel in units of the reference's mean square.
    fn variance(&self, binary: &Path, estimator: &str) -> anyhow::Result<Vec<f64>> {
        let scale = self.reference.norm().powi(2) / self.reference.pixels.len() as f64;
        let runs: anyhow::Result<Vec<Image>> = (0..SEEDS)
            .map(|seed| {
                let seed = seed.to_string();
                let flags = ["--estimator", estimator, "--spp", SPP, "--seed", &seed];
                Ok(gradient(binary, &self.scene, &self.wrt, &flags)?.images.remove(0))
            })
            .collect();
        Ok(variance(&runs?).into_iter().map(|v| v / scale).collect())
    }

    /// The mean over the pixels of a kind; 0 without such pixels.
    fn mean(&self, variance: &[f64], kind: PixelKind) -> f64 {
        let pairs = variance.iter().zip(&self.kinds);
        let own: Vec<f64> = pairs.filter(|(_, k)| **k == kind).map(|(v, _)| *v).collect();
        own.iter().fold(0.0, |sum, v| sum + v) / own.len().max(1) as f64
    }
}

/// The scene on a film with more pixels: some of them are then far from silhouettes.
fn magnified(mut scene: Value) -> anyhow::Result<Value> {
    let camera = scene.get_mut("camera").context("a camera")?;
    for key in ["width", "height", "focal"] {
        camera[key] = json!(camera[key].as_f64().context(key)? as u32 * MAGNIFIED);
    }
    let principal = camera["principal"].as_array_mut().context("camera/principal")?;
    for v in principal {
        *v = json!(v.as_f64().unwrap_or_default() * f64::from(MAGNIFIED));
    }
    Ok(scene)
}

/// The position of a pixel relative to the silhouettes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PixelKind {
    /// Covered by the object, and out of the Gaussian's reach of every silhouette.
    Inside,
    /// Crossed by a silhouette.
    Silhouette,
    /// All other pixels.
    Other,
}

/// The kinds of all pixels.
///
/// They come from the derivative of the image by the background's radiance, which is the share of a
/// pixel that the background covers.
fn pixel_kinds(reference: &Image, binary: &Path, scene: &Value) -> anyhow::Result<Vec<PixelKind>> {
    let by = vec!["/background/0".to_owned()];
    let flags = ["--estimator", "contour", "--spp", "256"];
    let background = gradient(binary, scene, &by, &flags)?.images.remove(0);
    let (width, height) =
        (reference.width as i64, (reference.pixels.len() / reference.width) as i64);
    let kind = |x: i64, y: i64| {
        let share = background.pixels[(y * width + x) as usize][0];
        if share < 1e-9 {
            PixelKind::Inside
        } else if share > 1.0 - 1e-9 {
            PixelKind::Other
        } else {
            PixelKind::Silhouette
        }
    };
    let near_silhouette = |x: i64, y: i64| {
        let around = (-REACH..=REACH).flat_map(|j| (-REACH..=REACH).map(move |i| (x + i, y + j)));
        around
            .filter(|(x, y)| (0..width).contains(x) && (0..height).contains(y))
            .any(|(x, y)| kind(x, y) == PixelKind::Silhouette)
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let kinds = pixels.map(|(x, y)| match kind(x, y) {
        PixelKind::Inside if near_silhouette(x, y) => PixelKind::Other,
        kind => kind,
    });
    Ok(kinds.collect())
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
