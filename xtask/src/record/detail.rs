//! Chamfer distance and error of normals against the time of a fit, with and without a grid.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};
use sweep::measure::dsdf;
use sweep::measure::plot::{Curve, Panel, svg};

use super::measurement::{Bench, Measurement, shared, wait_for_orphan};
use super::rows::{Planned, Rows, provenance};
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

/// A table of an older program with splines, on the same machine: its fits are those of these rows,
/// its results are compared by the program of today.
const BEFORE: &str = "before.csv";

/// The name of the older program's curve.
const OLDER: &str = "splines before Muon";

/// Errors of fits over their time.
pub(crate) struct Detail;

/// The name of a row.
fn row_name(set: &str, fit: &str, seconds: u32) -> String {
    format!("{set}, {fit}, {seconds} s")
}

/// All rows: a data set, the name and the options of a fit, and its time.
fn all() -> impl Iterator<Item = (&'static str, (&'static str, &'static [&'static str]), u32)> {
    let of_fit = |set, fit| SECONDS.into_iter().map(move |seconds| (set, fit, seconds));
    SETS.into_iter().flat_map(move |set| FITS.into_iter().flat_map(move |fit| of_fit(set, fit)))
}

impl Measurement for Detail {
    fn name(&self) -> &'static str {
        "detail"
    }

    fn measured(&self) -> &'static [&'static str] {
        super::fits::MEASURED
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |(set, (fit, options), seconds): (&str, (&str, &[&str]), u32)| {
            let options: String = options.iter().map(|option| format!(" {option}")).collect();
            let command = format!(
                "dsdf fit {set} -o RUN --time {seconds}s --masks ignore --threads 1{options}; dsdf \
                 eval RUN --mesh {MESH}"
            );
            Planned {
                needs: Some(shared().join("data").join(set)),
                ..Planned::new(row_name(set, fit, seconds), command).seeds([0])
            }
        };
        Ok(all().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let found = all().find(|(set, (fit, _), seconds)| row_name(set, fit, *seconds) == row.name);
        let (set, (_, options), seconds) = found.context("a fit of this name")?;
        let data = shared().join("data").join(set);
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let run = text(&bench.scratch.join("run"));
        wait_for_orphan(Path::new(&run))?;
        if Path::new(&run).exists() {
            std::fs::remove_dir_all(&run)?;
        }
        let (data_name, time) = (text(&data), format!("{seconds}s"));
        // The renders have masks, which a person's photographs have not.
        let mut fit = vec!["fit", &data_name, "-o", &run, "--time", &time, "--masks", "ignore"];
        fit.extend(["--threads", "1"]);
        fit.extend(options);
        let report = dsdf::run_json(bench.program, &fit)?;
        let truth = text(&data.join(MESH));
        let found = dsdf::run_json(bench.program, &["eval", &run, "--mesh", &truth])?;
        let mut values = json!({ "iterations": report["iterations"], "psnr": found["psnr"] });
        for (metric, _, _) in METRICS {
            values[metric] = found[metric].clone();
        }
        Ok(values)
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let header = "set,fit,seconds,iterations,chamfer_relative,normal_error,psnr\n";
        let mut csv = String::from(header);
        for (set, (fit, _), seconds) in all() {
            let Some(row) = rows.0.get(&row_name(set, fit, seconds)) else { continue };
            let Value::Object(values) = &row.values else { continue };
            let keys = ["iterations", "chamfer_relative", "normal_error", "psnr"];
            let cells = keys.map(|key| values.get(key).map_or(String::new(), Value::to_string));
            let _ = writeln!(csv, "{set},{fit},{seconds},{}", cells.join(","));
        }
        write(folder, "detail.csv", csv)?;
        let before = Before::read(folder)?;
        let mut panels = Vec::new();
        for set in SETS {
            for (metric, factor, label) in METRICS {
                let curve = |(fit, _): (&str, &[&str])| {
                    let point = |seconds| {
                        let value = rows.number(&row_name(set, fit, seconds), metric)?;
                        Some((f64::from(seconds), factor * value))
                    };
                    Curve {
                        name: fit.to_owned(),
                        points: SECONDS.into_iter().filter_map(point).collect(),
                    }
                };
                let mut curves: Vec<Curve> = FITS.into_iter().map(curve).collect();
                let older = |seconds| {
                    Some((f64::from(seconds), factor * before.get(set, seconds, metric)?))
                };
                let points: Vec<_> = SECONDS.into_iter().filter_map(older).collect();
                if !points.is_empty() {
                    curves.push(Curve { name: OLDER.to_owned(), points });
                }
                panels.push(Panel { title: format!("{set}: {label}"), curves, front: false });
            }
        }
        write(folder, "detail.svg", svg(&panels, "seconds of the fit on one core", "error"))?;
        write(folder, "detail.md", table(rows, &before) + "\n" + &provenance(rows) + "\n")
    }
}

/// The table of the older program.
struct Before(Vec<Vec<String>>);

impl Before {
    /// Reads the table; it has no lines if there is none.
    fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(BEFORE);
        let text = if path.exists() { std::fs::read_to_string(path)? } else { String::new() };
        let cells = |line: &str| line.split(',').map(str::to_owned).collect();
        Ok(Before(text.lines().map(cells).collect()))
    }

    /// A value of a set after a time.
    fn get(&self, set: &str, seconds: u32, value: &str) -> Option<f64> {
        let column = self.0.first()?.iter().position(|name| name == value)?;
        let is_own =
            |line: &&Vec<String>| line[0] == set && line.get(1) == Some(&seconds.to_string());
        self.0.iter().find(is_own)?.get(column)?.parse().ok()
    }
}

/// Distances and normals of each set and time, in Markdown.
fn table(rows: &Rows, before: &Before) -> String {
    let mut out = String::from("| set, seconds of one core |");
    FITS.iter().for_each(|(fit, _)| out += &format!(" {fit} |"));
    out += &format!(" {OLDER} |\n| --- | --- |");
    FITS.iter().for_each(|_| out += " --- |");
    out.push('\n');
    for set in SETS {
        for seconds in SECONDS {
            let _ = write!(out, "| `{set}`, {seconds} s |");
            let cell = |of: &dyn Fn(&str) -> Option<f64>| {
                let found = of("chamfer_relative").zip(of("normal_error"));
                let shown = found.map(|(d, n)| format!("{:.3} %, {n:.1}°", 100.0 * d));
                shown.unwrap_or_default()
            };
            for (fit, _) in FITS {
                let name = row_name(set, fit, seconds);
                let _ = write!(out, " {} |", cell(&|value| rows.number(&name, value)));
            }
            let _ = writeln!(out, " {} |", cell(&|value| before.get(set, seconds, value)));
        }
    }
    out
}
