//! The scenes and data sets of the bench.

use std::path::Path;

use serde_json::{Value, json};
use sweep::measure::dsdf;
use sweep::measure::suite;

/// A ball of constant radiance on a film of `size` × `size` pixels. It covers the same part of
/// every film.
pub(crate) fn disc(size: u32) -> Value {
    json!({
        "camera": {"width": size, "height": size, "focal": 2 * size,
                   "principal": [size / 2, size / 2], "eye": [0, 0, 4],
                   "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.05, 0.03, 0.0], "radius": 0.7},
        "appearance": {"type": "constant", "radiance": [1, 1, 1]},
        "background": [0, 0, 0]
    })
}

/// Renders 12 views of a lit ball, of `size` × `size` pixels, unless they are in `folder` already.
/// Returns the folder of this small data set.
pub(crate) fn photographs(binary: &Path, folder: &Path, size: u32) -> anyhow::Result<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let (scene, data) = (
        text(&folder.join("photographed.json")),
        text(&folder.join(format!("photographs.{size}"))),
    );
    std::fs::write(&scene, suite::scene("off-axis.lambert")?.to_string())?;
    if !Path::new(&data).exists() {
        let size = format!("{size}x{size}");
        dsdf::run_json(binary, &["synth", &scene, "-o", &data, "--views", "12", "--size", &size])?;
    }
    Ok(data)
}

/// The scene file of a network after one iteration of a fit with `options`, which is nearly a sphere of
/// half the bounding radius, with the camera of the disc.
pub(crate) fn network(
    binary: &Path,
    folder: &Path,
    pixels: u32,
    [width, layers]: [u32; 2],
    options: &[&str],
) -> anyhow::Result<String> {
    let data = photographs(binary, folder, 32)?;
    let run = folder.join(format!("run.{width}.{layers}"));
    let run_name = run.to_string_lossy().into_owned();
    let (width_text, layers_text) = (width.to_string(), layers.to_string());
    let shape = ["--width", &width_text, "--layers", &layers_text, "--iterations", "1"];
    dsdf::run_json(binary, &[&["fit", &data, "-o", &run_name], &shape[..], options].concat())?;
    let mut scene = disc(pixels);
    scene["sdf"] = json!({"type": "neural", "weights": run.join("model.safetensors")});
    let path = folder.join(format!("network.{width}.{layers}.json"));
    std::fs::write(&path, scene.to_string())?;
    Ok(path.to_string_lossy().into_owned())
}
