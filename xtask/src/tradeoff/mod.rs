//! `cargo xtask tradeoff`: cost and accuracy of each parameter, the Pareto front of all settings,
//! and the presets.

mod fits;
mod gradients;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::output::write;
use fits::{FitOutcome, NETWORKS, PRESETS};
use gradients::{AXES, Axis, AxisMeasurements, GradientScenes, Measurement, SPP};
use sweep::measure::dsdf;
use sweep::measure::plot::{Curve, Panel, front, svg};
use sweep::measure::reference::GAUSSIAN;
use sweep::measure::workspace_root;

/// Index in [`SPP`] of the samples per pixel in tables of one number.
const SHOWN: usize = 2;

/// The presets of `dsdf gradient`.
const GRADIENT_PRESETS: [&str; 3] = ["fast", "balanced", "accurate"];

/// Measures derivative images and fits, and writes CSV, SVG and tables into the folder `output`.
pub(crate) fn run(output: Option<PathBuf>) -> anyhow::Result<()> {
    let folder = output.unwrap_or_else(|| workspace_root().join("docs/results/tradeoff"));
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let binary = dsdf::build()?;
    let scenes = GradientScenes::new(&binary)?;
    let measured = measure_axes(&scenes, &binary, &folder)?;
    let presets = measure_presets(&scenes, &binary)?;
    let fits = measure_fits(&binary, &folder)?;
    write(&folder, "tradeoff.md", page(&measured, &presets, &fits))?;
    eprintln!("{}", folder.display());
    Ok(())
}

/// Measures all axes, and writes `gradients.csv` and `gradients.svg` after each.
fn measure_axes(
    scenes: &GradientScenes,
    binary: &Path,
    folder: &Path,
) -> anyhow::Result<Vec<AxisMeasurements>> {
    let mut csv = String::from("parameter,value,spp,scene,seconds,rmse,bias\n");
    let (mut panels, mut all) = (Vec::new(), Vec::new());
    for (i, axis) in AXES.iter().enumerate() {
        eprintln!("{} of {}: {}", i + 1, AXES.len(), axis.name);
        let measured = scenes.measure_axis(binary, axis, &mut csv)?;
        let curves = curves(axis, &measured);
        panels.push(Panel { title: axis.name.to_owned(), curves, front: false });
        write(folder, "gradients.csv", &csv)?;
        write(folder, "gradients.svg", svg(&panels, "seconds", "RMSE"))?;
        all.push(measured);
    }
    Ok(all)
}

/// One curve of error over seconds for each value of an axis.
fn curves(axis: &Axis, measured: &AxisMeasurements) -> Vec<Curve> {
    let points =
        |of_value: &Vec<Measurement>| of_value.iter().map(|m| (m.seconds, m.error)).collect();
    axis.values
        .iter()
        .zip(measured)
        .map(|(name, of_value)| Curve { name: (*name).to_owned(), points: points(of_value) })
        .collect()
}

/// The presets of `dsdf gradient`, each with its name.
fn measure_presets(
    scenes: &GradientScenes,
    binary: &Path,
) -> anyhow::Result<Vec<(&'static str, Measurement)>> {
    let measure = |preset| {
        let flags = ["--preset", preset];
        Ok((preset, scenes.measure(binary, &flags, preset, &mut String::new())?))
    };
    GRADIENT_PRESETS.into_iter().map(measure).collect()
}

/// Fits with different networks for the same time, and with the presets of `dsdf fit`.
fn measure_fits(binary: &Path, folder: &Path) -> anyhow::Result<Vec<FitOutcome>> {
    let scratch = tempfile::tempdir()?;
    let data = fits::photographs(binary, scratch.path())?;
    let mut csv = String::from("setting,seconds,iterations,psnr,chamfer_relative\n");
    let mut outcomes = Vec::new();
    for setting in NETWORKS.iter().chain(&PRESETS) {
        eprintln!("fit {} ({})", setting.name, setting.flags.join(" "));
        outcomes.push(fits::measure(binary, scratch.path(), &data, setting, &mut csv)?);
        write(folder, "fits.csv", &csv)?;
    }
    Ok(outcomes)
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
fn page(
    measured: &[AxisMeasurements],
    presets: &[(&'static str, Measurement)],
    fits: &[FitOutcome],
) -> String {
    let mut out = String::from(
        "Written by `cargo xtask tradeoff`. Relative L2 errors of derivative images, geometric \
         means over four scenes and eight seeds each.\n\n",
    );
    axes_table(&mut out, measured);
    front_table(&mut out, measured);
    out += "\n## Presets of `dsdf gradient`\n\n\
            | preset | milliseconds | RMSE | bias |\n|---|---|---|---|\n";
    for (name, Measurement { seconds, error, bias }) in presets {
        let _ = writeln!(out, "| {name} | {:.2} | {error:.4} | {bias:.4} |", seconds * 1e3);
    }
    fits_table(&mut out, fits);
    out
}

/// The table of all axes at one number of samples.
fn axes_table(out: &mut String, measured: &[AxisMeasurements]) {
    let _ = writeln!(
        out,
        "## One parameter at a time, {} samples a pixel\n\n\
         | parameter | value | milliseconds | RMSE | bias |\n|---|---|---|---|---|",
        SPP[SHOWN]
    );
    for (axis, of_axis) in AXES.iter().zip(measured) {
        for (value, of_value) in axis.values.iter().zip(of_axis) {
            let Measurement { seconds, error, bias } = of_value[SHOWN];
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
fn pareto_points(measured: &[AxisMeasurements]) -> Vec<ParetoPoint> {
    let mut points = Vec::new();
    for (axis, of_axis) in AXES.iter().zip(measured) {
        for (value, of_value) in axis.values.iter().zip(of_axis) {
            if *value == axis.default || GAUSSIAN.contains(value) {
                continue;
            }
            for (spp, Measurement { seconds, error, .. }) in SPP.iter().zip(of_value) {
                let name = format!("{} {value}, {spp} samples", axis.name);
                points.push(ParetoPoint { name, seconds: *seconds, error: *error });
            }
        }
    }
    points
}

/// The table of the Pareto front, cheapest setting first.
fn front_table(out: &mut String, measured: &[AxisMeasurements]) {
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
fn fits_table(out: &mut String, fits: &[FitOutcome]) {
    *out += "\n## Fits of the demo's scene, 24 views of 128 × 128\n\n\
             | setting | seconds | iterations | PSNR, dB | Chamfer, of the radius |\n\
             |---|---|---|---|---|\n";
    for FitOutcome { name, seconds, iterations, psnr, chamfer } in fits {
        let _ = writeln!(
            out,
            "| {name} | {seconds:.0} | {iterations} | {psnr:.1} | {:.2} % |",
            chamfer * 100.0
        );
    }
}
