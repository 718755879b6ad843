//! The test of gradients on a cell's iterates: derivative images of the model's silhouette with the
//! cell's estimator, against the contour integral.

use std::path::Path;

use crate::error::Error;
use crate::measure::dsdf::{RunDsdf, gradient};
use crate::measure::image::{Image, SquaredError};
use crate::measure::reference::{GAUSSIAN, gaussian_filtered};
use crate::report::Cell;
use crate::report::files::write_whole;
use crate::report::options::{flag, text};
use serde_json::{Value, json};

use crate::process::LimitedProgram;
use crate::runner::CellRunner;

/// Samples per pixel of the reference. Its error is 0.7 %, a hundredth of the measured errors.
const REFERENCE_SPP: &str = "256";

/// The parameter: a random direction of the weights.
const WEIGHTS: &str = "/sdf/weights/0";

/// The bounding ball and the options in a run's `fit.toml`.
struct FitFile {
    center: [f64; 3],
    radius: f64,
    options: toml::Value,
}

impl FitFile {
    fn read(run: &Path) -> Result<Self, Error> {
        let file: toml::Table = toml::from_str(&std::fs::read_to_string(run.join("fit.toml"))?)
            .map_err(Error::content)?;
        let bounds: Vec<f64> = file
            .get("bounds")
            .and_then(toml::Value::as_array)
            .ok_or_else(Error::lacks("bounds in fit.toml"))?
            .iter()
            .filter_map(toml::Value::as_float)
            .collect();
        let &[x, y, z, radius] = &bounds[..] else {
            return Err(Error::content(format!("bounds of {} numbers", bounds.len())));
        };
        let options = file.get("options").ok_or_else(Error::lacks("options in fit.toml"))?.clone();
        Ok(FitFile { center: [x, y, z], radius, options })
    }

    /// The estimator's name.
    fn estimator(&self) -> Result<String, Error> {
        Ok(text(self.options.get("estimator").ok_or_else(Error::lacks("estimator in fit.toml"))?))
    }

    /// The options of `dsdf gradient` for the estimator of the fit. Both commands take lengths in
    /// bounding radii.
    fn estimator_flags(&self) -> Result<Vec<String>, Error> {
        let mut flags = flag(("estimator".to_owned(), self.estimator()?));
        let warp = self.options.get("warp").and_then(toml::Value::as_table);
        for (key, value) in warp.ok_or_else(Error::lacks("options.warp in fit.toml"))? {
            flags.extend(flag((key.clone(), text(value))));
        }
        Ok(flags)
    }

    /// The run's model with radiance 1 in front of a background of 0, on a film of `size` × `size`
    /// pixels. The camera is three bounding radii from the centre: the bounding ball fills the
    /// film.
    fn silhouette_scene(&self, run: &Path, size: u32) -> Value {
        let ([x, y, z], radius) = (self.center, self.radius);
        let eye = [x + 1.44 * radius, y - 1.8 * radius, z + 1.92 * radius];
        json!({
            "camera": {"width": size, "height": size, "focal": 1.4 * f64::from(size),
                       "principal": [f64::from(size) / 2.0, f64::from(size) / 2.0],
                       "eye": eye, "target": self.center, "up": [0, 0, 1]},
            "sdf": {"type": "neural", "weights": run.join("model.safetensors")},
            "appearance": {"type": "constant", "radiance": [1, 1, 1]},
            "background": [0, 0, 0]
        })
    }
}

impl CellRunner<'_> {
    /// The relative bias (L2) and the relative variance (squared L2) of the cell's estimator at the
    /// model in the folder `run`. They are kept in `NAME.gradient.json`.
    pub(crate) fn gradients(
        &self,
        cell: &Cell,
        folder: &Path,
        name: &str,
        run: &Path,
    ) -> Result<[f64; 2], Error> {
        let path = folder.join(format!("{name}.gradient.json"));
        if let Some(known) = known(&path) {
            return Ok(known);
        }
        let fit = FitFile::read(run)?;
        let mut flags = fit.estimator_flags()?;
        flags.extend(self.gradient_flags(cell));
        let log = folder.join(format!("{name}.gradient.log"));
        let program =
            LimitedProgram { program: self.binary, limits: &self.sweep.limits, log: &log };
        let scene = fit.silhouette_scene(run, self.sweep.gradient.size);
        let reference = reference(&program, &scene, &fit.estimator()?)?;
        let runs: Vec<Image> = (0..self.sweep.gradient.runs)
            .map(|seed| derivative(&program, &scene, &flags, seed))
            .collect::<Result<_, Error>>()?;
        let found = bias_and_variance(&runs, &reference)?;
        write_whole(&path, serde_json::to_vec(&found).map_err(Error::content)?)?;
        Ok(found)
    }

    /// The options of `dsdf gradient` that the sweep sets: precision, samples, threads. If the
    /// sweep varies the samples of the fit, the test takes as many.
    fn gradient_flags(&self, cell: &Cell) -> Vec<String> {
        let mut flags = Vec::new();
        if let Some(precision) = self.sweep.setting(cell, "gradient_precision") {
            flags.extend(flag(("precision".to_owned(), precision)));
        }
        let options = self.sweep.options(cell);
        let swept =
            ["spp", "edge_rays"].iter().find_map(|key| options.iter().find(|(k, _)| k == key));
        let spp = swept.map_or(self.sweep.gradient.spp.to_string(), |(_, v)| v.clone());
        flags.extend([format!("--spp={spp}"), self.threads()]);
        flags
    }
}

/// The numbers of an earlier test.
fn known(path: &Path) -> Option<[f64; 2]> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

/// The derivative image by contours, under the pixel filter of the estimator.
fn reference(program: &impl RunDsdf, scene: &Value, estimator: &str) -> Result<Image, Error> {
    let wrt = [WEIGHTS.to_owned()];
    if GAUSSIAN.contains(&estimator) {
        return Ok(gaussian_filtered(program, scene, &wrt)?.remove(0));
    }
    let flags = ["--estimator", "contour", "--spp", REFERENCE_SPP];
    Ok(gradient(program, scene, &wrt, &flags)?.images.remove(0))
}

/// The derivative image of one run.
fn derivative(
    program: &impl RunDsdf,
    scene: &Value,
    flags: &[String],
    seed: u32,
) -> Result<Image, Error> {
    let seed = format!("--seed={seed}");
    let flags: Vec<&str> = flags.iter().map(String::as_str).chain([seed.as_str()]).collect();
    Ok(gradient(program, scene, &[WEIGHTS.to_owned()], &flags)?.images.remove(0))
}

/// The bias relative to the reference's norm, and the variance of one run relative to the norm's
/// square: the squared error of a run less the squared bias.
fn bias_and_variance(runs: &[Image], reference: &Image) -> Result<[f64; 2], Error> {
    let error = SquaredError::of(&runs.iter().collect::<Vec<_>>(), reference);
    let norm = reference.norm();
    if norm.is_nan() || norm <= 0.0 {
        return Err(Error::content("nothing is in sight"));
    }
    let bias = error.bias.max(0.0);
    let found = [bias.sqrt() / norm, (error.run - bias).max(0.0) / (norm * norm)];
    if found.iter().all(|v| v.is_finite()) { Ok(found) } else { Err(Error::content("not finite")) }
}
