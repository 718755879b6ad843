//! The figures of `docs/math`: drawings that are computed from the formulas on its pages, and
//! derivative images of a disc against their closed form.

mod ball;
mod border;
mod disc;
mod drawing;
mod lines;
mod measured;
mod opacity;
mod ray;
mod velocity;

use std::path::Path;

use serde_json::{Value, json};

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows};
use crate::output::write;

/// The drawings of `docs/math`.
pub(crate) struct Math;

impl Measurement for Math {
    fn name(&self) -> &'static str {
        "math"
    }

    fn measured(&self) -> &'static [&'static str] {
        &[
            "scene",
            "estimate",
            "crates/sweep/src/measure/",
            "tests/gradients/",
            "xtask/src/record/math/",
        ]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let command = "dsdf gradient tests/gradients/disc.constant.json, with several settings";
        Ok(vec![Planned::new("the disc", command.to_owned()).seeds([1])])
    }

    /// Writes the drawings too: none of them is random.
    fn measure(&self, _: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let drawings = [
            ("disc.svg", disc::draw()),
            ("ray.svg", ray::draw()),
            ("velocity.svg", velocity::draw()),
            ("border.svg", border::draw()),
            ("lines.svg", lines::draw()),
            ("opacity.svg", opacity::draw()),
            ("images.svg", measured::pictures(bench.program)?),
        ];
        for (name, drawing) in drawings {
            write(bench.folder, name, drawing)?;
        }
        let (plot, table) = measured::errors(bench.program)?;
        write(bench.folder, "errors.svg", plot)?;
        Ok(json!({ "csv": table }))
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        write(folder, "errors.csv", rows.csv(&self.plan()?, ""))
    }
}
