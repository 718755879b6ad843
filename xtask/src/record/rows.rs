//! The rows of a measurement: those to measure, and those in a file of `docs/results`, with when,
//! where and by which code they were measured.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::output::write;

/// The file of rows in the folder of a measurement.
const FILE: &str = "record.json";

/// A row to measure.
#[derive(Clone, Debug)]
pub(crate) struct Planned {
    /// Its name in the file of rows.
    pub(crate) name: String,
    /// The command that makes the row.
    pub(crate) command: String,
    /// The seeds.
    pub(crate) seeds: Vec<u64>,
    /// Whether it uses one thread, so that others can be measured beside it.
    pub(crate) is_single: bool,
    /// A file or folder outside of the repository that it reads.
    pub(crate) needs: Option<PathBuf>,
}

impl Planned {
    /// A row of a measurement that uses all threads and needs no other files.
    pub(crate) fn new(name: impl Into<String>, command: String) -> Self {
        Planned { name: name.into(), command, seeds: Vec::new(), is_single: false, needs: None }
    }

    /// The row with these seeds.
    pub(crate) fn seeds(self, seeds: impl IntoIterator<Item = u64>) -> Self {
        Planned { seeds: seeds.into_iter().collect(), ..self }
    }
}

/// A row that was measured.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Row {
    /// The command that makes the row.
    pub(crate) command: String,
    /// The seeds; none if nothing in the row is random.
    pub(crate) seeds: Vec<u64>,
    /// The digest of the measured code.
    pub(crate) code: String,
    /// The commit of the checkout, with `-dirty` if files differed from it.
    pub(crate) commit: String,
    /// The processor.
    pub(crate) machine: String,
    /// The number of hardware threads.
    pub(crate) cores: usize,
    /// The day of the measurement, in UTC.
    pub(crate) date: String,
    /// The wall time of the measurement.
    pub(crate) seconds: f64,
    /// The number of rows that were measured at a time.
    pub(crate) jobs: usize,
    /// The measured values, with units by their names.
    pub(crate) values: Value,
}

/// The measured rows of a measurement, by their names.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(transparent)]
pub(crate) struct Rows(pub(crate) BTreeMap<String, Row>);

impl Rows {
    /// The rows of a folder; none if it has no file of rows.
    ///
    /// # Errors
    /// If the file cannot be read, or is none of rows.
    pub(crate) fn load(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(FILE);
        if !path.exists() {
            return Ok(Rows::default());
        }
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| path.display().to_string())
    }

    /// Replaces the file of rows whole.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn save(&self, folder: &Path) -> anyhow::Result<()> {
        write(folder, FILE, serde_json::to_string_pretty(self)? + "\n")
    }

    /// The rows of a plan that were measured, in its order.
    pub(crate) fn in_order<'a>(
        &'a self,
        plan: &'a [Planned],
    ) -> impl Iterator<Item = (&'a str, &'a Row)> {
        plan.iter().filter_map(|planned| Some((&*planned.name, self.0.get(&planned.name)?)))
    }

    /// The lines of a table of comma-separated values: those of the value `csv` of each row.
    pub(crate) fn csv(&self, plan: &[Planned], header: &str) -> String {
        let lines = self.in_order(plan).filter_map(|(_, row)| row.values["csv"].as_str());
        header.to_owned() + &lines.collect::<String>()
    }

    /// A value of a row: a number.
    pub(crate) fn number(&self, row: &str, value: &str) -> Option<f64> {
        self.0.get(row)?.values[value].as_f64()
    }
}

/// Says where and when rows were measured: a line for tables.
pub(crate) fn provenance(rows: &Rows) -> String {
    let list = |of: fn(&Row) -> String| {
        let mut all: Vec<String> = rows.0.values().map(of).collect();
        all.sort();
        all.dedup();
        all
    };
    let (commits, dates) = (list(|row| row.commit.clone()), list(|row| row.date.clone()));
    let machines = list(|row| format!("{}, {} cores", row.machine, row.cores));
    let dates = match &dates[..] {
        [] => String::new(),
        [one] => one.clone(),
        [first, .., last] => format!("{first} to {last}"),
    };
    format!("Measured on {} ({dates}), dsdf {}.", machines.join("; "), commits.join(", "))
}
