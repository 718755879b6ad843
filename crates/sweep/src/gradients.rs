//! The test of gradients on a cell's iterates: derivative images of a silhouette, against contours.

use std::path::Path;

use anyhow::Context;
use serde_json::json;

use super::cell::Bench;
use super::process::Limited;
use super::results::write;
use super::sweep::{Cell, flag, text};
use measure::dsdf::{Image, Spread, gradient};
use measure::reference::{GAUSSIAN, gaussian_filtered};

/// Samples of the reference: 0.7 % off, a hundredth of what is measured.
const CONTOURS: &str = "256";

impl Bench<'_> {
    /// Bias of the cell's estimator at a run's model, relative L2, and its variance in the same
    /// unit squared.
    pub(super) fn gradients(
        &self,
        cell: &Cell,
        folder: &Path,
        name: &str,
        run: &Path,
    ) -> anyhow::Result<[f64; 2]> {
        let path = folder.join(format!("{name}.gradient.json"));
        let known = std::fs::read_to_string(&path)
            .ok()
            .and_then(|t| serde_json::from_str::<[f64; 2]>(&t).ok());
        if let Some(known) = known {
            return Ok(known);
        }
        let test = &self.sweep.gradient;
        let file: toml::Table = toml::from_str(&std::fs::read_to_string(run.join("fit.toml"))?)?;
        let bounds: Vec<f64> = file
            .get("bounds")
            .and_then(toml::Value::as_array)
            .context("bounds in fit.toml")?
            .iter()
            .filter_map(toml::Value::as_float)
            .collect();
        let &[x, y, z, radius] = &bounds[..] else {
            anyhow::bail!("bounds of {} numbers", bounds.len())
        };
        let options = file.get("options").context("options in fit.toml")?;
        let option = |key: &str| options.get(key).map(text).unwrap_or_default();
        let length = |key: &str| {
            option(key).parse::<f64>().map(|v| (v * radius).to_string()).unwrap_or_default()
        };
        let estimator = option("estimator");
        let mut flags: Vec<String> = [
            ("estimator", estimator.clone()),
            ("steps", option("steps")),
            ("top_k", option("top_k")),
            ("gamma", option("gamma")),
            ("epsilon", length("epsilon")),
            ("lambda_d", length("lambda_d")),
        ]
        .into_iter()
        .flat_map(|(key, value)| flag((key.to_owned(), value)))
        .collect();
        if let Some(precision) = self.sweep.setting(cell, "gradient_precision") {
            flags.extend(flag(("precision".to_owned(), precision)));
        }
        // Where samples are swept, as many as the fit takes.
        let swept =
            ["spp", "edge_rays"].iter().find_map(|key| cell.values.iter().find(|(k, _)| k == key));
        let spp = swept.map_or(test.spp.to_string(), |(_, v)| v.clone());
        flags.extend([format!("--spp={spp}"), self.threads()]);
        let log = folder.join(format!("{name}.gradient.log"));
        let program = Limited { program: self.binary, limits: &self.sweep.limits, log: &log };
        // Three radii away, where the ball of bounds fills the film.
        let eye = [x + 1.44 * radius, y - 1.8 * radius, z + 1.92 * radius];
        let size = test.size;
        let scene = json!({
            "camera": {"width": size, "height": size, "focal": 1.4 * f64::from(size),
                       "principal": [f64::from(size) / 2.0, f64::from(size) / 2.0],
                       "eye": eye, "target": [x, y, z], "up": [0, 0, 1]},
            "sdf": {"type": "neural", "weights": run.join("model.safetensors")},
            "appearance": {"type": "constant", "radiance": [1, 1, 1]},
            "background": [0, 0, 0]
        });
        let wrt = ["/sdf/weights/0".to_owned()];
        let gaussian = GAUSSIAN.contains(&estimator.as_str());
        let reference = if gaussian {
            gaussian_filtered(&program, &scene, &wrt)?.remove(0)
        } else {
            gradient(&program, &scene, &wrt, &["--estimator", "contour", "--spp", CONTOURS])?
                .images
                .remove(0)
        };
        let images: Vec<Image> = (0..test.runs)
            .map(|seed| {
                let seed = format!("--seed={seed}");
                let flags: Vec<&str> =
                    flags.iter().map(String::as_str).chain([seed.as_str()]).collect();
                Ok(gradient(&program, &scene, &wrt, &flags)?.images.remove(0))
            })
            .collect::<anyhow::Result<_>>()?;
        let spread = Spread::of(&images.iter().collect::<Vec<_>>(), &reference);
        let norm = reference.norm();
        anyhow::ensure!(norm > 0.0, "nothing is in sight");
        // Of one run: what is not bias.
        let bias = spread.bias.max(0.0);
        let found = [bias.sqrt() / norm, (spread.run - bias).max(0.0) / (norm * norm)];
        anyhow::ensure!(found.iter().all(|v| v.is_finite()), "not finite");
        write(&path, serde_json::to_vec(&found)?)?;
        Ok(found)
    }
}
