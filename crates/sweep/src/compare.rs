//! Two sweeps side by side.

use std::fmt::Write;
use std::path::Path;

use super::claims::{error_name, percent, short, worse};
use super::refusal::Refusal;
use super::results::{Better, METRICS, Row, from_csv, settings};

/// Compares the rows of two sweeps that have data set, parameters and seed in common.
pub(super) fn compare(a: &Path, b: &Path) -> anyhow::Result<String> {
    let read = |path: &Path| {
        from_csv(&if path.is_dir() { path.join("results.csv") } else { path.to_owned() })
    };
    let (of_a, of_b) = (read(a)?, read(b)?);
    let shared = |own: &[Row], other: &[Row], side: &str| -> Vec<Row> {
        let common = own.iter().filter(|r| other.iter().any(|o| o.key() == r.key()));
        common
            .map(|r| {
                let mut values = r.key().2;
                values.push(("sweep".to_owned(), side.to_owned()));
                Row { values, ..r.clone() }
            })
            .collect()
    };
    let both = [shared(&of_a, &of_b, "A"), shared(&of_b, &of_a, "B")].concat();
    let count = both.iter().filter(|r| r.value("sweep") == "A").count();
    if count == 0 {
        return Err(Refusal::new(
            b,
            "cells",
            "none in common",
            format!("cells of {}", a.display()),
        )
        .into());
    }
    let only = |own: &[Row], other: &[Row]| {
        own.iter().filter(|r| !other.iter().any(|o| o.key() == r.key())).count()
    };
    let mut out = format!("# Two sweeps\n\nA: {}\nB: {}\n\n", a.display(), b.display());
    let _ = writeln!(
        out,
        "{count} cells in common, {} only in A, {} only in B.\n",
        only(&of_a, &of_b),
        only(&of_b, &of_a)
    );
    let converged =
        |side: &str| both.iter().filter(|r| r.value("sweep") == side && r.converged).count();
    let _ = writeln!(out, "Converged: {} of A, {} of B.\n", converged("A"), converged("B"));
    let _ = writeln!(out, "| what | B over A | 95 % | p |\n|---|---|---|---|");
    for metric in METRICS.iter().filter(|m| m.name != "iterations") {
        let there = |side: &str| {
            both.iter().any(|r| r.value("sweep") == side && r.numbers.contains_key(metric.name))
        };
        if !there("A") || !there("B") {
            continue;
        }
        let found = worse(&both, "sweep", "B", "A", metric);
        if found.mean.is_finite() {
            let name = if metric.better == Better::Cost {
                metric.label.to_owned()
            } else {
                error_name(metric)
            };
            let (low, high) = (percent(found.low), percent(found.high));
            let _ = writeln!(
                out,
                "| {name} | {} | {low} to {high} | {} |",
                percent(found.mean),
                short(found.p)
            );
        }
    }
    let _ = writeln!(
        out,
        "\n| cell | seed | Chamfer A | Chamfer B | PSNR A | PSNR B |\n|---|---|---|---|---|---|"
    );
    for row in of_a.iter() {
        let Some(other) = of_b.iter().find(|o| o.key() == row.key()) else { continue };
        let number = |row: &Row, name: &str, factor: f64| {
            row.numbers.get(name).map_or(row.status.clone(), |v| format!("{:.3}", v * factor))
        };
        let _ = writeln!(
            out,
            "| {}, {} | {} | {} | {} | {} | {} |",
            row.data,
            settings(&row.values),
            row.seed,
            number(row, "chamfer", 100.0),
            number(other, "chamfer", 100.0),
            number(row, "psnr", 1.0),
            number(other, "psnr", 1.0)
        );
    }
    Ok(out)
}
