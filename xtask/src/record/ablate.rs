//! The shipped sweeps with their reports.

use std::path::Path;
use std::process::Command;

use anyhow::ensure;
use serde_json::{Value, json};

use super::measurement::{Bench, Measurement, wait_for_orphan};
use super::rows::{Planned, Rows};
use crate::output::write;

/// The sweeps whose reports pages quote.
const SWEEPS: [&str; 6] =
    ["k-gamma", "high-gamma", "bare", "steps-epsilon", "steps-refined", "detail"];

/// The files of a report that are kept; the cells themselves are large.
const KEPT: [&str; 7] =
    ["report.md", "report.html", "results.csv", "curves.svg", "grid.png", "heat.svg", "pareto.svg"];

/// Sweeps of fits, a report each.
pub(crate) struct Ablations;

impl Measurement for Ablations {
    fn name(&self) -> &'static str {
        "ablate"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "fit", "metrics", "mesh", "sweep", "xtask/sweeps/"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |name: &str| Planned::new(name, format!("cargo xtask ablate {name} -o {name}"));
        Ok(SWEEPS.into_iter().map(row).collect())
    }

    /// A sweep that was killed goes on where it was: its cells are in the row's own folder.
    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        wait_for_orphan(bench.scratch)?;
        let status = Command::new(std::env::current_exe()?)
            .args(["ablate", &row.name, "--binary"])
            .arg(bench.program)
            .arg("-o")
            .arg(bench.scratch)
            .status()?;
        ensure!(status.success(), "the sweep {} failed", row.name);
        let to = bench.folder.join(&row.name);
        std::fs::create_dir_all(&to)?;
        for name in KEPT {
            let from = bench.scratch.join(name);
            if from.exists() {
                write(&to, name, std::fs::read(&from)?)?;
            }
        }
        let results = std::fs::read_to_string(to.join("results.csv"))?;
        Ok(json!({ "cells": results.lines().count().saturating_sub(1) }))
    }

    /// Nothing: a sweep writes its own report.
    fn write(&self, _: &Rows, _: &Path) -> anyhow::Result<()> {
        Ok(())
    }
}
