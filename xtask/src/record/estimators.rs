//! Error against seconds, of every estimator on every scene of the gradient suite.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};
use sweep::measure::dsdf::gradient;
use sweep::measure::image::Image;
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::reference::{box_filtered, gaussian_filtered};
use sweep::measure::suite::{Case, cases, scene};

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows, provenance};
use crate::output::write;

/// The estimators, each with whether its pixels are Gaussian-filtered.
const ESTIMATORS: [(&str, bool); 8] = [
    ("interior", false),
    ("paper", false),
    ("paper-all", false),
    ("gaussian", true),
    ("was", true),
    ("loubet", true),
    ("band", false),
    ("refined", false),
];

/// Samples per pixel. The first number at which a run takes longer than the limit is the last.
const SPP: [u32; 6] = [4, 16, 64, 256, 1024, 4096];

/// The limit of a run, in seconds.
const LIMIT_SECONDS: f64 = 0.6;

/// The time of the comparison in the table, in seconds.
const AT: f64 = 0.3;

/// Runs of every cell; the error is the root of their mean square.
const SEEDS: u32 = 2;

/// Seconds and relative error of one estimator on one scene, for growing numbers of samples.
type ErrorCurve = Vec<(f64, f64)>;

/// Errors of derivative images at equal time.
pub(crate) struct Estimators;

impl Measurement for Estimators {
    fn name(&self) -> &'static str {
        "estimators"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "crates/sweep/src/measure/", "tests/gradients/"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |case: Case| {
            let command = format!(
                "dsdf gradient tests/gradients/{}.json --wrt {} --estimator E --spp {} to {} --seed S",
                case.scene,
                case.wrt.join(" --wrt "),
                SPP[0],
                SPP[SPP.len() - 1]
            );
            Planned::new(case.scene, command).seeds((0..SEEDS).map(u64::from))
        };
        Ok(cases()?.into_iter().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let case = cases()?.into_iter().find(|case| case.scene == row.name);
        let mut csv = String::new();
        let curves = curves(bench.program, &case.context("a scene of the suite")?, &mut csv)?;
        Ok(json!({ "csv": csv, "curves": curves }))
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let header = "scene,wrt,estimator,spp,seed,seconds,evaluations,relative_l2\n";
        let (mut panels, mut lines) = (Vec::new(), Vec::new());
        let plan = self.plan()?;
        for (name, row) in rows.in_order(&plan) {
            let curves: Vec<ErrorCurve> = serde_json::from_value(row.values["curves"].clone())?;
            lines.push(table_row(name, &curves));
            let curve = |((name, _), points): (&(&str, bool), ErrorCurve)| Curve {
                name: (*name).to_owned(),
                points,
            };
            panels.push(Panel {
                title: name.to_owned(),
                curves: ESTIMATORS.iter().zip(curves).map(curve).collect(),
                front: false,
            });
        }
        write(folder, "estimators.csv", rows.csv(&plan, header))?;
        write(folder, "estimators.svg", svg(&panels, "seconds", "relative L2 error"))?;
        write(folder, "estimators.md", page(&lines) + &provenance(rows) + "\n")
    }
}

/// The error curve of every estimator on a case. Adds rows to `csv`.
fn curves(binary: &Path, case: &Case, csv: &mut String) -> anyhow::Result<Vec<ErrorCurve>> {
    let scene = scene(&case.scene)?;
    let references =
        [box_filtered(binary, &scene, &case.wrt)?, gaussian_filtered(binary, &scene, &case.wrt)?];
    let mut curves = Vec::new();
    for (estimator, gaussian) in ESTIMATORS {
        let reference = &references[usize::from(gaussian)];
        let mut curve = ErrorCurve::new();
        for spp in SPP {
            let cell = ErrorMeasurement { binary, case, scene: &scene, reference, estimator, spp };
            curve.push(cell.measure(csv)?);
            if curve[curve.len() - 1].0 > LIMIT_SECONDS {
                break;
            }
        }
        curves.push(curve);
    }
    Ok(curves)
}

/// One estimator with one number of samples on one case.
struct ErrorMeasurement<'a> {
    /// The program `dsdf`.
    binary: &'a Path,
    case: &'a Case,
    scene: &'a Value,
    /// One image for each parameter of the case.
    reference: &'a [Image],
    estimator: &'a str,
    spp: u32,
}

impl ErrorMeasurement<'_> {
    /// Seconds of a run and relative error, root mean square over seeds and parameters. Adds a row
    /// to `csv` for each seed and parameter.
    fn measure(&self, csv: &mut String) -> anyhow::Result<(f64, f64)> {
        let ErrorMeasurement { case, estimator, spp, .. } = self;
        let (mut seconds, mut square) = (0.0, 0.0);
        for seed in 0..SEEDS {
            let (spp_text, seed_text) = (spp.to_string(), seed.to_string());
            let flags = ["--estimator", estimator, "--spp", &spp_text, "--seed", &seed_text];
            let got = gradient(self.binary, self.scene, &case.wrt, &flags)?;
            seconds += got.seconds / f64::from(SEEDS);
            for ((wrt, image), reference) in case.wrt.iter().zip(&got.images).zip(self.reference) {
                let error = image.distance(reference) / reference.norm();
                square += error * error / (f64::from(SEEDS) * case.wrt.len() as f64);
                let _ = writeln!(
                    csv,
                    "{},{wrt},{estimator},{spp},{seed},{:.5},{},{error:.6}",
                    case.scene, got.seconds, got.evaluations
                );
            }
        }
        Ok((seconds, square.sqrt()))
    }
}

/// The error at a time, interpolated along the straight lines of a log–log plot. Outside of the
/// measured times it is that of the nearest end.
fn error_at(curve: &ErrorCurve, seconds: f64) -> f64 {
    for pair in curve.windows(2) {
        let [(t0, e0), (t1, e1)] = [pair[0], pair[1]];
        if seconds >= t0 && seconds <= t1 && t1 > t0 {
            let share = (seconds / t0).ln() / (t1 / t0).ln();
            return e0 * (e1 / e0).powf(share);
        }
    }
    let before = curve.first().is_some_and(|first| seconds < first.0);
    let end = if before { curve.first() } else { curve.last() };
    end.map_or(f64::NAN, |end| end.1)
}

/// The errors of a scene at equal time.
fn table_row(scene: &str, curves: &[ErrorCurve]) -> (String, Vec<f64>) {
    (scene.to_owned(), curves.iter().map(|curve| error_at(curve, AT)).collect())
}

/// The tables of the scenes with each appearance, in Markdown.
fn page(rows: &[(String, Vec<f64>)]) -> String {
    let mut out = format!(
        "Relative L2 error of derivative images after {AT} s, root mean square over {SEEDS} seeds \
         and all parameters.\n\n"
    );
    for (appearance, title) in
        [("constant", "Constant radiance"), ("lambert", "Lambertian"), ("normal", "Normals")]
    {
        let own = rows.iter().filter(|(scene, _)| scene.ends_with(&format!(".{appearance}")));
        let _ = write!(out, "## {title}\n\n{}\n", table(&mut own.map(|row| (&*row.0, &*row.1))));
    }
    out
}

/// A table of scenes.
fn table(rows: &mut dyn Iterator<Item = (&str, &[f64])>) -> String {
    let mut out = String::from("| scene |");
    ESTIMATORS.iter().for_each(|(name, _)| out += &format!(" {name} |"));
    out += " next best over `refined` |\n|---|";
    ESTIMATORS.iter().for_each(|_| out += "---|");
    out += "---|\n";
    for (scene, errors) in rows {
        let _ = write!(out, "| {scene} |");
        errors.iter().for_each(|e| out += &format!(" {e:.4} |"));
        let (refined, others) = (errors[errors.len() - 1], &errors[..errors.len() - 1]);
        let best = others.iter().copied().fold(f64::MAX, f64::min);
        let _ = writeln!(out, " {:.1} × |", best / refined);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_interpolated_on_log_log_lines() {
        let curve = vec![(0.01, 1.0), (1.0, 0.01)];
        assert!((error_at(&curve, 0.1) - 0.1).abs() < 1e-12);
        assert_eq!(error_at(&curve, 5.0), 0.01);
        assert_eq!(error_at(&curve, 0.001), 1.0);
    }
}
