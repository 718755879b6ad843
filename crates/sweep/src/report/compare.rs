//! Two sweeps side by side, for `--compare`.

use std::fmt::Write;
use std::path::Path;

use crate::error::Error;
use crate::report::metrics::{Better, METRICS, Metric};
use crate::report::pairs::{error_name, error_ratio, p_value, percent};
use crate::report::results::{CellResult, describe};
use crate::report::results_csv::from_csv;
use crate::report::statistics::Interval;
use files::InputError;

/// The parameter that is added to the settings of common cells, with the values `A` and `B`.
const SIDE: &str = "sweep";

/// The results of two sweeps.
struct Comparison {
    /// All results of the first sweep.
    a: Vec<CellResult>,
    /// All results of the second sweep.
    b: Vec<CellResult>,
    /// Those that agree in data set, parameters and seed, with the parameter [`SIDE`].
    common: Vec<CellResult>,
}

/// Compares the results of two sweeps, given as folders or as files `results.csv`.
///
/// Returns a page in Markdown: ratios of the errors of `b` to those of `a`, and a table of the
/// common cells.
///
/// # Errors
/// An [`InputError`] if a file cannot be read, or if the sweeps have no cell in common.
pub fn compare(a: &Path, b: &Path) -> Result<String, Error> {
    let read = |path: &Path| {
        from_csv(&if path.is_dir() { path.join("results.csv") } else { path.to_owned() })
    };
    let comparison = Comparison::new(read(a)?, read(b)?);
    if comparison.common.is_empty() {
        let expected = format!("cells of {}", a.display());
        return Err(InputError::new(b, "cells", "none in common", expected).into());
    }
    let mut out = format!("# Two sweeps\n\nA: {}\nB: {}\n\n", a.display(), b.display());
    comparison.counts(&mut out);
    comparison.metrics(&mut out);
    comparison.cells(&mut out);
    Ok(out)
}

/// The text in place of an interval that does not exist.
const NO_INTERVAL: &str = "needs two pairs or more, of different data sets or seeds";

/// The interval and the p value of a ratio, as two fields of a table. Both need two pairs, since
/// they come from the scatter among pairs.
fn certainty(ratio: Interval) -> String {
    if ratio.count < 2 {
        return format!("{NO_INTERVAL} | -");
    }
    format!("{} to {} | {}", percent(ratio.low), percent(ratio.high), p_value(ratio.p))
}

/// The results of `own` whose cells `other` has too, marked as of one side.
fn shared(own: &[CellResult], other: &[CellResult], side: &str) -> Vec<CellResult> {
    let mark = |r: &CellResult| {
        let mut values = r.key().2;
        values.push((SIDE.to_owned(), side.to_owned()));
        CellResult { values, ..r.clone() }
    };
    own.iter().filter(|r| other.iter().any(|o| o.key() == r.key())).map(mark).collect()
}

impl Comparison {
    fn new(a: Vec<CellResult>, b: Vec<CellResult>) -> Self {
        let common = [shared(&a, &b, "A"), shared(&b, &a, "B")].concat();
        Comparison { a, b, common }
    }

    /// The common results of one side.
    fn side(&self, side: &str) -> impl Iterator<Item = &CellResult> {
        self.common.iter().filter(move |r| r.value(SIDE) == side)
    }

    /// Numbers of cells, and of fits that converged.
    fn counts(&self, out: &mut String) {
        let only = |own: &[CellResult], other: &[CellResult]| {
            own.iter().filter(|r| !other.iter().any(|o| o.key() == r.key())).count()
        };
        let _ = writeln!(
            out,
            "{} cells in common, {} only in A, {} only in B.\n",
            self.side("A").count(),
            only(&self.a, &self.b),
            only(&self.b, &self.a)
        );
        let converged = |side: &str| self.side(side).filter(|r| r.converged).count();
        let _ = writeln!(out, "Converged: {} of A, {} of B.\n", converged("A"), converged("B"));
    }

    /// The ratio of the errors of B to those of A, for every metric that both have.
    fn metrics(&self, out: &mut String) {
        let _ = writeln!(out, "| metric | B over A | 95 % | p |\n|---|---|---|---|");
        let known = |side: &str, metric: &Metric| self.side(side).any(|r| r.has(metric));
        for metric in METRICS.iter().filter(|m| m.name != "iterations") {
            if !known("A", metric) || !known("B", metric) {
                continue;
            }
            let ratio = error_ratio(&self.common, SIDE, "B", "A", metric);
            if !ratio.mean.is_finite() {
                continue;
            }
            let cost = metric.better == Better::Cost;
            let name = if cost { metric.label.to_owned() } else { error_name(metric) };
            let _ = writeln!(out, "| {name} | {} | {} |", percent(ratio.mean), certainty(ratio));
        }
    }

    /// Chamfer distance and PSNR of every common cell.
    fn cells(&self, out: &mut String) {
        let _ = writeln!(
            out,
            "\n| cell | seed | Chamfer A | Chamfer B | PSNR A | PSNR B |\n|---|---|---|---|---|---|"
        );
        for a in &self.a {
            let Some(b) = self.b.iter().find(|b| b.key() == a.key()) else { continue };
            let number = |r: &CellResult, name: &str, factor: f64| {
                r.numbers.get(name).map_or(r.status.clone(), |v| format!("{:.3}", v * factor))
            };
            let _ = writeln!(
                out,
                "| {}, {} | {} | {} | {} | {} | {} |",
                a.data,
                describe(&a.values),
                a.seed,
                number(a, "chamfer", 100.0),
                number(b, "chamfer", 100.0),
                number(a, "psnr", 1.0),
                number(b, "psnr", 1.0)
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Results of one setting and the seeds 1, 2, …, with these Chamfer distances.
    fn results(chamfer: &[f64]) -> Vec<CellResult> {
        let result = |(seed, chamfer): (u64, &f64)| CellResult {
            data: "knot".to_owned(),
            seed,
            numbers: [("chamfer".to_owned(), *chamfer)].into(),
            ..CellResult::default()
        };
        (1..).zip(chamfer).map(result).collect()
    }

    #[test]
    fn an_interval_needs_two_pairs() {
        let table = |a: &[f64], b: &[f64]| {
            let mut out = String::new();
            Comparison::new(results(a), results(b)).metrics(&mut out);
            out
        };
        let one = table(&[0.01], &[0.02]);
        assert!(one.contains("| 200 % | needs two pairs or more, of different data"), "{one}");
        assert!(one.ends_with(" | - |\n") && !one.contains('?'), "{one}");
        let two = table(&[0.01, 0.03], &[0.02, 0.06]);
        assert!(two.ends_with("| 200 % | 200 % to 200 % | < 0.001 |\n"), "{two}");
    }
}
