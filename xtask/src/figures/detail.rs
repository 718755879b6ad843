//! Chamfer distance and error of normals against the time of a fit, with and without a grid.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, ensure};
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::{dsdf, workspace_root};

use crate::output::write;

/// Data sets of renders, in the folder `shared/data` beside the workspace: a smooth solid, and one
/// with ridges.
const SETS: [&str; 2] = ["spot", "ridged"];

/// The true surface in a data set.
const MESH: &str = "mesh_normalized.ply";

/// Times of a fit, in seconds.
const SECONDS: [u32; 5] = [15, 30, 60, 120, 240];

/// Curves, and the options of their fits.
const FITS: [(&str, &[&str]); 2] = [("octaves", &["--grid", "none"]), ("octaves and splines", &[])];

/// Metrics of `dsdf eval --json`: name, the factor of a plot, label.
const METRICS: [(&str, f64, &str); 2] = [
    ("chamfer_relative", 100.0, "Chamfer distance, % of the radius"),
    ("normal_error", 1.0, "mean error of normals, degrees"),
];

/// Fits each data set for each time, and writes `detail.csv` and `detail.svg`.
pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let data = workspace_root().join("../shared/data");
    for set in SETS {
        let mesh = data.join(set).join(MESH);
        ensure!(mesh.is_file(), "{}: found no file, expected a mesh", mesh.display());
    }
    let mut csv = String::from("set,fit,seconds,iterations,chamfer_relative,normal_error,psnr\n");
    let mut panels = Vec::new();
    for set in SETS {
        let set_folder = data.join(set);
        let mut curves: [Vec<Curve>; METRICS.len()] = Default::default();
        for (name, options) in FITS {
            let mut points: [Vec<(f64, f64)>; METRICS.len()] = Default::default();
            for seconds in SECONDS {
                eprintln!("{set}, {name}, {seconds} s");
                let row = fit(binary, &set_folder, seconds, options)?;
                for ((metric, factor, _), points) in METRICS.iter().zip(&mut points) {
                    let value = row[*metric].as_f64().context(*metric)?;
                    points.push((f64::from(seconds), factor * value));
                }
                let _ = writeln!(
                    csv,
                    "{set},{name},{seconds},{},{},{},{}",
                    row["iterations"], row["chamfer_relative"], row["normal_error"], row["psnr"]
                );
                write(folder, "detail.csv", &csv)?;
            }
            for (curves, points) in curves.iter_mut().zip(points) {
                curves.push(Curve { name: name.to_owned(), points });
            }
        }
        panels.extend(METRICS.iter().zip(curves).map(|((_, _, label), curves)| Panel {
            title: format!("{set}: {label}"),
            curves,
            front: false,
        }));
    }
    write(folder, "detail.svg", svg(&panels, "seconds of the fit", "error"))
}

/// The evaluation of a fit, with its number of iterations.
fn fit(
    binary: &Path,
    data: &Path,
    seconds: u32,
    options: &[&str],
) -> anyhow::Result<serde_json::Value> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run").to_string_lossy().into_owned();
    let time = format!("{seconds}s");
    let path = data.to_string_lossy();
    // The renders have masks, which a person's photographs have not.
    let fit = [&["fit", &path, "-o", &run, "--time", &time, "--masks", "ignore"], options].concat();
    let report = dsdf::run_json(binary, &fit)?;
    let truth = data.join(MESH).to_string_lossy().into_owned();
    let mut row = dsdf::run_json(binary, &["eval", &run, "--mesh", &truth])?;
    row["iterations"] = report["iterations"].clone();
    Ok(row)
}
