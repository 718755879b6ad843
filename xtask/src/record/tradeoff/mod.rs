//! Cost and accuracy of each parameter, the Pareto front of all settings,
//! and the presets.

mod fits;
mod gradients;

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, bail};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Row, Rows, provenance};
use crate::output::write;
use fits::{FitOutcome, FitSetting, NETWORKS, PRESETS};
use gradients::{AXES, Axis, AxisMeasurements, Cost, GradientScenes, SPP};
use sweep::measure::plot::{Curve, Panel, front, svg};
use sweep::measure::reference::GAUSSIAN;

/// Index in [`SPP`] of the samples per pixel in tables of one number.
const SHOWN: usize = 2;

/// The presets of `dsdf gradient`.
const GRADIENT_PRESETS: [&str; 3] = ["fast", "balanced", "accurate"];

/// Cost and accuracy of each parameter of derivative images, of the presets, and of networks.
pub(crate) struct Tradeoff;

/// What a row measures.
#[derive(Clone, Copy)]
enum Setting {
    /// All values of a parameter of derivative images.
    Axis(&'static Axis),
    /// A preset of derivative images.
    Preset(&'static str),
    /// A network or a preset of fits.
    Fit(&'static FitSetting),
}

impl Setting {
    fn all() -> impl Iterator<Item = Setting> {
        let presets = GRADIENT_PRESETS.into_iter().map(Setting::Preset);
        let fits = NETWORKS.iter().chain(&PRESETS).map(Setting::Fit);
        AXES.iter().map(Setting::Axis).chain(presets).chain(fits)
    }

    fn row(self) -> Planned {
        let scenes = "for each of four scenes of tests/gradients";
        match self {
            Setting::Axis(axis) => {
                let command = format!("dsdf gradient SCENE {} --seed S, {scenes}", axis.options());
                Planned::new(axis.name, command).seeds(gradients::seeds())
            }
            Setting::Preset(name) => {
                let command = format!("dsdf gradient SCENE --preset {name} --seed S, {scenes}");
                Planned::new(format!("preset {name} of gradient"), command)
                    .seeds(gradients::seeds())
            }
            Setting::Fit(fit) => {
                let command =
                    format!("dsdf fit DATA -o RUN {}; {}", fit.flags.join(" "), fits::DATA);
                Planned::new(format!("fit {}", fit.name), command).seeds([0])
            }
        }
    }
}

impl Measurement for Tradeoff {
    fn name(&self) -> &'static str {
        "tradeoff"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "fit", "metrics", "mesh", "crates/app/src/cli/preset.rs"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        Ok(Setting::all().map(Setting::row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let setting = Setting::all().find(|setting| setting.row().name == row.name);
        let mut csv = String::new();
        let values = match setting.context("a setting of this name")? {
            Setting::Axis(axis) => {
                let scenes = GradientScenes::new(bench.program)?;
                json!({ "axis": scenes.measure_axis(bench.program, axis, &mut csv)? })
            }
            Setting::Preset(name) => {
                let (scenes, flags) = (GradientScenes::new(bench.program)?, ["--preset", name]);
                json!({ "preset": scenes.measure(bench.program, &flags, name, &mut csv)? })
            }
            Setting::Fit(setting) => {
                json!({ "fit": fits::measure(bench.program, bench.scratch, setting)? })
            }
        };
        let Value::Object(mut values) = values else { bail!("no object") };
        values.insert("csv".to_owned(), csv.into());
        Ok(values.into())
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let mut all = Measured::default();
        for setting in Setting::all() {
            let Some(row) = rows.0.get(&setting.row().name) else { continue };
            match setting {
                Setting::Axis(axis) => all.axes.push((axis, value(row, "axis")?)),
                Setting::Preset(name) => all.presets.push((name, value(row, "preset")?)),
                Setting::Fit(fit) => all.fits.push((fit.name, value(row, "fit")?)),
            }
        }
        let panel = |(axis, measured): &(&Axis, AxisMeasurements)| {
            let curves = curves(axis, measured);
            Panel { title: axis.name.to_owned(), curves, front: false }
        };
        let panels: Vec<Panel> = all.axes.iter().map(panel).collect();
        write(folder, "gradients.svg", svg(&panels, "seconds", "RMSE"))?;
        let axes: Vec<Planned> = AXES.iter().map(|axis| Setting::Axis(axis).row()).collect();
        let header = "parameter,value,spp,scene,seconds,rmse,bias\n";
        write(folder, "gradients.csv", rows.csv(&axes, header))?;
        write(folder, "fits.csv", fits_csv(&all.fits))?;
        write(folder, "tradeoff.md", page(&all) + "\n" + &provenance(rows) + "\n")
    }
}

/// A value of a row.
fn value<T: DeserializeOwned>(row: &Row, key: &str) -> anyhow::Result<T> {
    serde_json::from_value(row.values[key].clone()).with_context(|| key.to_owned())
}

/// What was measured.
#[derive(Default)]
struct Measured {
    axes: Vec<(&'static Axis, AxisMeasurements)>,
    presets: Vec<(&'static str, Cost)>,
    fits: Vec<(&'static str, FitOutcome)>,
}

/// The fits as comma-separated values.
fn fits_csv(fits: &[(&str, FitOutcome)]) -> String {
    let mut csv = String::from("setting,seconds,iterations,psnr,chamfer_relative\n");
    for (name, FitOutcome { seconds, iterations, psnr, chamfer }) in fits {
        let _ = writeln!(csv, "{name},{seconds:.2},{iterations},{psnr:.2},{chamfer:.5}");
    }
    csv
}

/// One curve of error over seconds for each value of an axis.
fn curves(axis: &Axis, measured: &AxisMeasurements) -> Vec<Curve> {
    let points = |of_value: &Vec<Cost>| of_value.iter().map(|m| (m.seconds, m.error)).collect();
    axis.values
        .iter()
        .zip(measured)
        .map(|(name, of_value)| Curve { name: (*name).to_owned(), points: points(of_value) })
        .collect()
}

/// A setting with its cost and its error, for the Pareto front.
struct ParetoPoint {
    /// Parameter, value and samples.
    name: String,
    /// Wall time of one run.
    seconds: f64,
    /// Relative L2, root mean square.
    error: f64,
}

/// All tables, in Markdown.
fn page(all: &Measured) -> String {
    let mut out = String::from(
        "Relative L2 errors of derivative images, geometric means over four scenes and eight seeds \
         each.\n\n",
    );
    axes_table(&mut out, &all.axes);
    front_table(&mut out, &all.axes);
    out += "\n## Presets of `dsdf gradient`\n\n\
            | preset | milliseconds | RMSE | bias |\n|---|---|---|---|\n";
    for (name, Cost { seconds, error, bias }) in &all.presets {
        let _ = writeln!(out, "| {name} | {:.2} | {error:.4} | {bias:.4} |", seconds * 1e3);
    }
    fits_table(&mut out, &all.fits);
    out
}

/// The table of all axes at one number of samples.
fn axes_table(out: &mut String, measured: &[(&Axis, AxisMeasurements)]) {
    let _ = writeln!(
        out,
        "## One parameter at a time, {} samples a pixel\n\n\
         | parameter | value | milliseconds | RMSE | bias |\n|---|---|---|---|---|",
        SPP[SHOWN]
    );
    for (axis, of_axis) in measured {
        for (value, of_value) in axis.values.iter().zip(of_axis) {
            let Cost { seconds, error, bias } = of_value[SHOWN];
            let milliseconds = seconds * 1e3;
            let _ = writeln!(
                out,
                "| {} | {value} | {milliseconds:.2} | {error:.4} | {bias:.4} |",
                axis.name
            );
        }
    }
}

/// The points of all axes. A value that is the default is measured elsewhere already, and a
/// Gaussian-filtered image is another image: both are left out.
fn pareto_points(measured: &[(&Axis, AxisMeasurements)]) -> Vec<ParetoPoint> {
    let mut points = Vec::new();
    for (axis, of_axis) in measured {
        for (value, of_value) in axis.values.iter().zip(of_axis) {
            if *value == axis.default || GAUSSIAN.contains(value) {
                continue;
            }
            for (spp, Cost { seconds, error, .. }) in SPP.iter().zip(of_value) {
                let name = format!("{} {value}, {spp} samples", axis.name);
                points.push(ParetoPoint { name, seconds: *seconds, error: *error });
            }
        }
    }
    points
}

/// The table of the Pareto front, cheapest setting first.
fn front_table(out: &mut String, measured: &[(&Axis, AxisMeasurements)]) {
    *out += "\n## The Pareto front\n\n\
             Of all settings and samples above, those that no other beats in both time and \
             error.\n\n\
             | setting | milliseconds | RMSE |\n|---|---|---|\n";
    for point in front(pareto_points(measured), |p| (p.seconds, p.error)) {
        let ParetoPoint { name, seconds, error } = point;
        let _ = writeln!(out, "| {name} | {:.2} | {error:.4} |", seconds * 1e3);
    }
}

/// The table of the fits.
fn fits_table(out: &mut String, fits: &[(&str, FitOutcome)]) {
    *out += "\n## Fits of the demo's scene, 24 views of 128 × 128\n\n\
             | setting | seconds | iterations | PSNR, dB | Chamfer, of the radius |\n\
             |---|---|---|---|---|\n";
    for (name, FitOutcome { seconds, iterations, psnr, chamfer }) in fits {
        let _ = writeln!(
            out,
            "| {name} | {seconds:.0} | {iterations} | {psnr:.1} | {:.2} % |",
            chamfer * 100.0
        );
    }
}
