//! The throughput of network passes, the time and memory of commands, and how times grow.

use std::fmt::Write;
use std::path::Path;

use anyhow::bail;
use serde_json::{Value, json};

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows, provenance};
use crate::bench::{Machine, accuracy, growth, programs, workers};
use crate::output::write;

/// Times on this machine.
pub(crate) struct Speed;

/// Threads of the simulated iterations.
const WORKERS: [usize; 2] = [2, 16];

/// The rows. A table shows all but the accuracy, which is in the file of rows.
const ROWS: [&str; 5] = ["passes", "commands", "accuracy", "growth", "workers"];

impl Measurement for Speed {
    fn name(&self) -> &'static str {
        "speed"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "fit"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let command = |name: &str| match name {
            "workers" => format!("cargo xtask bench --workers {}", WORKERS[1]),
            _ => "cargo xtask bench".to_owned(),
        };
        Ok(ROWS.into_iter().map(|name| Planned::new(name, command(name))).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        Ok(match &*row.name {
            "passes" => serde_json::to_value(Machine::measure()?)?,
            "commands" => json!({ "commands": programs::measure(bench.program)? }),
            "accuracy" => serde_json::to_value(accuracy::measure(bench.program)?)?,
            "growth" => json!({ "growth": growth::measure(bench.program)? }),
            "workers" => json!({ "workers": workers::measure(bench.program, &WORKERS)? }),
            other => bail!("{other}: no such row"),
        })
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let mut out = String::new();
        for (title, table) in [
            ("Passes", passes(rows)),
            ("Commands", commands(rows)),
            ("Growth", growth_table(rows)),
            ("Workers", workers_table(rows)),
        ] {
            let _ = write!(out, "## {title}\n\n{table}\n");
        }
        write(folder, "speed.md", out + &provenance(rows) + "\n")
    }
}

/// The objects in a list of a row.
fn objects<'a>(rows: &'a Rows, row: &str, list: &str) -> Vec<&'a Value> {
    let of_row = rows.0.get(row).and_then(|row| row.values[list].as_array());
    of_row.into_iter().flatten().collect()
}

/// A number of an object.
fn number(object: &Value, key: &str) -> f64 {
    object[key].as_f64().unwrap_or(f64::NAN)
}

/// A text of an object.
fn text<'a>(object: &'a Value, key: &str) -> &'a str {
    object[key].as_str().unwrap_or_default()
}

/// A line for each network: its passes in points per second, with the part of the core's peak.
fn passes(rows: &Rows) -> String {
    let all = objects(rows, "passes", "passes");
    let distinct = |key: &str| {
        let mut found: Vec<&str> = Vec::new();
        for name in all.iter().map(|pass| text(pass, key)) {
            if !found.contains(&name) {
                found.push(name);
            }
        }
        found
    };
    let names = distinct("pass");
    let mut out = format!(
        "| M points/s | {} |\n| --- |{}\n",
        names.join(" | "),
        " --- |".repeat(names.len())
    );
    for network in distinct("network") {
        let _ = write!(out, "| {network} |");
        for pass in all.iter().filter(|pass| text(pass, "network") == network) {
            let millions = number(pass, "points_per_second") / 1e6;
            let _ = write!(out, " {millions:.2}, {:.0} % |", number(pass, "percent_of_peak"));
        }
        out.push('\n');
    }
    if let Some(peak) = rows.0.get("passes").map(|row| &row.values["peak"]) {
        let (gflops, instructions) = (number(peak, "gflops"), text(peak, "instructions"));
        let _ = writeln!(out, "\nThe peak of one core: {gflops:.0} GFLOP/s ({instructions}).");
    }
    out
}

fn commands(rows: &Rows) -> String {
    let mut out = String::from("| command | time | memory |\n| --- | --- | --- |\n");
    for command in objects(rows, "commands", "commands") {
        let memory = command["peak_mebibytes"].as_f64();
        let _ = writeln!(
            out,
            "| {} | {:.1} ms | {} |",
            text(command, "name"),
            1e3 * number(command, "seconds"),
            memory.map_or(String::new(), |memory| format!("{memory:.0} MiB")),
        );
    }
    out
}

fn growth_table(rows: &Rows) -> String {
    let mut out = String::from("| the time grows with | as its power |\n| --- | --- |\n");
    for growth in objects(rows, "growth", "growth") {
        let _ = writeln!(out, "| {} | {:.2} |", text(growth, "with"), number(growth, "exponent"));
    }
    out
}

fn workers_table(rows: &Rows) -> String {
    let mut out = String::from(
        "| surface | simulated threads | times as fast | efficiency |\n| --- | --- | --- | --- |\n",
    );
    for row in objects(rows, "workers", "workers") {
        let of = &row["result"];
        let _ = writeln!(
            out,
            "| {} | {} | {:.1} | {:.0} % |",
            text(row, "surface"),
            row["workers"],
            number(of, "speed_up"),
            100.0 * number(of, "efficiency"),
        );
    }
    out
}
