//! Derivative images of two scenes against images by another program.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};
use sweep::measure::dsdf::gradient;
use sweep::measure::npy::read_image;

use super::measurement::{Bench, Measurement, shared};
use super::rows::{Planned, Rows, provenance};
use crate::output::write;

/// The scenes, with their names in the table.
const SCENES: [(&str, &str); 2] =
    [("sphere", "sphere, constant radiance"), ("sphere_lambert", "sphere, Lambertian")];

/// The estimators, with their names in the table.
const ESTIMATORS: [(&str, &str); 2] =
    [("refined", "`refined`, the default"), ("paper", "`paper`, the published estimator")];

/// The parameters: the radius, and the centre across the view and along it.
const WRT: [&str; 3] = ["/sdf/radius", "/sdf/center/0", "/sdf/center/2"];

/// Samples per pixel.
const SPP: &str = "256";

/// Relative errors of derivative images.
pub(crate) struct Derivatives;

/// The name of a row.
fn row_name(scene: &str, estimator: &str) -> String {
    format!("{scene}, {estimator}")
}

/// All rows: scenes with estimators.
fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
    SCENES.into_iter().flat_map(|(scene, _)| ESTIMATORS.map(|(estimator, _)| (scene, estimator)))
}

impl Measurement for Derivatives {
    fn name(&self) -> &'static str {
        "derivatives"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "crates/sweep/src/measure/"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |(scene, estimator): (&str, &str)| {
            let wrt = WRT.join(" --wrt ");
            let command = format!(
                "dsdf gradient {scene}.json --wrt {wrt} --estimator {estimator} --spp {SPP} -o g.npy"
            );
            Planned {
                needs: Some(reference(scene)),
                ..Planned::new(row_name(scene, estimator), command).seeds([0])
            }
        };
        Ok(all().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let found = all().find(|(scene, estimator)| row_name(scene, estimator) == row.name);
        let (name, estimator) = found.context("a scene of this name")?;
        let file = reference(name);
        let scene: Value = serde_json::from_str(&std::fs::read_to_string(&file)?)?;
        let wrt = WRT.map(str::to_owned);
        let flags = ["--estimator", estimator, "--spp", SPP];
        let got = gradient(bench.program, &scene, &wrt, &flags)?;
        let mut errors = Vec::new();
        for (pointer, image) in WRT.iter().zip(&got.images) {
            let pointer = pointer.trim_start_matches('/').replace('/', "_");
            let exact = read_image(&file.with_file_name(format!("{name}.d_{pointer}.npy")))?;
            errors.push(image.distance(&exact) / exact.norm());
        }
        Ok(json!({ "relative_l2": errors, "seconds": got.seconds }))
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let mut out = String::from("| scene |");
        ESTIMATORS.iter().for_each(|(_, name)| out += &format!(" {name} |"));
        out += "\n| --- | --- | --- |\n";
        for (scene, name) in SCENES {
            let _ = write!(out, "| {name} |");
            for (estimator, _) in ESTIMATORS {
                let row = rows.0.get(&row_name(scene, estimator));
                let errors = row.and_then(|row| row.values["relative_l2"].as_array());
                let shown = errors.into_iter().flatten().filter_map(Value::as_f64).map(per_cent);
                let _ = write!(out, " {} |", shown.collect::<Vec<_>>().join(", "));
            }
            out.push('\n');
        }
        write(folder, "derivatives.md", out + "\n" + &provenance(rows) + "\n")
    }
}

/// The file of a scene, beside its derivative images.
fn reference(scene: &str) -> std::path::PathBuf {
    shared().join(format!("reference/gradients/{scene}.json"))
}

/// A relative error in percent: one digit below 10 %.
fn per_cent(error: f64) -> String {
    if error < 0.1 { format!("{:.1} %", 100.0 * error) } else { format!("{:.0} %", 100.0 * error) }
}
