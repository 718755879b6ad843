//! `cargo xtask tradeoff`: what each parameter costs and buys, and which settings nothing beats.

mod fits;
mod gradients;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::figures::write;
use fits::{Fitted, NETWORKS, PRESETS};
use gradients::{AXES, Axis, Cell, Cells, Gradients, SPP};
use measure::dsdf;
use measure::plot::{Curve, Panel, front, svg};
use measure::reference::GAUSSIAN;

/// The samples a pixel that tables of one number show.
const SHOWN: usize = 2;

/// Measures everything, and writes CSV, SVG and tables.
pub(crate) fn run(output: Option<PathBuf>) -> anyhow::Result<()> {
    let folder = output.unwrap_or_else(|| dsdf::root().join("docs/results/tradeoff"));
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let binary = dsdf::build()?;
    let gradients = Gradients::new(&binary)?;
    let measured = measure_gradients(&gradients, &binary, &folder)?;
    let gradient_presets = measure_presets(&gradients, &binary)?;
    let fits = measure_fits(&binary, &folder)?;
    write(&folder, "tradeoff.md", page(&measured, &gradient_presets, &fits))?;
    eprintln!("{}", folder.display());
    Ok(())
}

/// All axes; what is measured is written at once.
fn measure_gradients(
    gradients: &Gradients,
    binary: &Path,
    folder: &Path,
) -> anyhow::Result<Vec<Cells>> {
    let mut csv = String::from("parameter,value,spp,scene,seconds,rmse,bias\n");
    let (mut panels, mut all) = (Vec::new(), Vec::new());
    for (i, axis) in AXES.iter().enumerate() {
        eprintln!("{} of {}: {}", i + 1, AXES.len(), axis.name);
        let cells = gradients.measure(binary, axis, &mut csv)?;
        panels.push(Panel {
            title: axis.name.to_owned(),
            curves: curves(axis, &cells),
            front: false,
        });
        write(folder, "gradients.csv", &csv)?;
        write(folder, "gradients.svg", svg(&panels, "seconds", "RMSE"))?;
        all.push(cells);
    }
    Ok(all)
}

fn curves(axis: &Axis, cells: &Cells) -> Vec<Curve> {
    let points = |ladder: &Vec<Cell>| ladder.iter().map(|c| (c.seconds, c.error)).collect();
    axis.values
        .iter()
        .zip(cells)
        .map(|(name, l)| Curve { name: (*name).to_owned(), points: points(l) })
        .collect()
}

/// The presets of `dsdf gradient`.
fn measure_presets(
    gradients: &Gradients,
    binary: &Path,
) -> anyhow::Result<Vec<(&'static str, Cell)>> {
    let cell = |preset| {
        Ok((preset, gradients.cell(binary, &["--preset", preset], preset, &mut String::new())?))
    };
    ["fast", "balanced", "accurate"].into_iter().map(cell).collect()
}

/// Networks for the same time, and the presets of `dsdf fit`.
fn measure_fits(binary: &Path, folder: &Path) -> anyhow::Result<Vec<Fitted>> {
    let scratch = tempfile::tempdir()?;
    let data = fits::photographs(binary, scratch.path())?;
    let mut csv = String::from("setting,seconds,iterations,psnr,chamfer_relative\n");
    let mut fitted = Vec::new();
    for setting in NETWORKS.iter().chain(&PRESETS) {
        eprintln!("fit {} ({})", setting.name, setting.flags.join(" "));
        fitted.push(fits::measure(binary, scratch.path(), &data, setting, &mut csv)?);
        write(folder, "fits.csv", &csv)?;
    }
    Ok(fitted)
}

/// A setting with its cost and its error.
struct Point {
    name: String,
    seconds: f64,
    error: f64,
}

fn page(measured: &[Cells], presets: &[(&'static str, Cell)], fits: &[Fitted]) -> String {
    let mut out = format!(
        "Written by `cargo xtask tradeoff`. Relative L2 errors of derivative images, geometric means over four scenes and eight \
         seeds each.\n\n## One parameter at a time, {} samples a pixel\n\n| parameter | value | milliseconds | RMSE | bias |\n|---|---|---|---|---|\n",
        SPP[SHOWN]
    );
    let mut points = Vec::new();
    for (axis, cells) in AXES.iter().zip(measured) {
        for (value, ladder) in axis.values.iter().zip(cells) {
            let Cell { seconds, error, bias } = ladder[SHOWN];
            let _ = writeln!(
                out,
                "| {} | {value} | {:.2} | {error:.4} | {bias:.4} |",
                axis.name,
                seconds * 1e3
            );
            // What is measured under another name anyway, or is of another image, is not of the
            // front.
            let counts = *value != axis.default && !GAUSSIAN.contains(value);
            for (spp, cell) in SPP.iter().zip(ladder).filter(|_| counts) {
                let name = format!("{} {value}, {spp} samples", axis.name);
                points.push(Point { name, seconds: cell.seconds, error: cell.error });
            }
        }
    }
    out += "\n## The Pareto front\n\nOf all settings and samples above, those that no other beats in both time and error.\n\n\
            | setting | milliseconds | RMSE |\n|---|---|---|\n";
    for Point { name, seconds, error } in front(points, |p| (p.seconds, p.error)) {
        let _ = writeln!(out, "| {name} | {:.2} | {error:.4} |", seconds * 1e3);
    }
    out += "\n## Presets of `dsdf gradient`\n\n| preset | milliseconds | RMSE | bias |\n|---|---|---|---|\n";
    for (name, Cell { seconds, error, bias }) in presets {
        let _ = writeln!(out, "| {name} | {:.2} | {error:.4} | {bias:.4} |", seconds * 1e3);
    }
    out += "\n## Fits of the demo's scene, 24 views of 128 × 128\n\n| setting | seconds | iterations | PSNR, dB | Chamfer, of the radius |\n|---|---|---|---|---|\n";
    for Fitted { name, seconds, iterations, psnr, chamfer } in fits {
        let _ = writeln!(
            out,
            "| {name} | {seconds:.0} | {iterations} | {psnr:.1} | {:.2} % |",
            chamfer * 100.0
        );
    }
    out
}
