//! The result of a cell: its file `result.json`, and a row of `results.csv`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::report::files::read_text;
use crate::report::metrics::Metric;
use crate::report::options::{Settings, long_name};
use crate::report::schema::Convergence;
use crate::report::sweep::{Cell, Sweep};

/// The result of a cell.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct CellResult {
    /// The data set's name.
    pub data: String,
    /// The parameters with their values, in the sweep's order.
    pub values: Settings,
    /// The seed of the fit.
    pub seed: u64,
    /// `done`, `failed`, `time` or `memory`.
    pub status: String,
    /// Why the cell is not done; empty if it is.
    pub reason: String,
    /// Whether the fit converged, by the sweep's criterion.
    pub converged: bool,
    /// The known metrics, by name.
    pub numbers: BTreeMap<String, f64>,
    /// The loss curve: an iteration, and the mean loss of the part of the fit that starts there.
    #[serde(default)]
    pub curve: Vec<(f64, f64)>,
}

/// The identity of a result: data set, seed, and settings by their long names, sorted.
pub type ResultKey = (String, u64, Settings);

/// Cost of a gradient, a Hessian–vector product and a parameter gradient in values of f.
const COSTS: [(&str, f64); 4] =
    [("values", 1.0), ("gradients", 2.0), ("hessian_vectors", 4.0), ("parameters", 6.0)];

impl CellResult {
    /// A result without numbers, of status `done`.
    ///
    /// # Panics
    /// If the cell is of a sweep with more data sets.
    pub fn new(sweep: &Sweep, cell: &Cell) -> Self {
        CellResult {
            data: sweep.data[cell.data].name.clone(),
            values: cell.values.clone(),
            seed: cell.seed,
            status: "done".to_owned(),
            ..CellResult::default()
        }
    }

    /// Whether the result meets the criterion of convergence. Without a true surface only the loss
    /// decides.
    pub fn meets(&self, criterion: &Convergence, has_truth: bool) -> bool {
        let number = |name: &str| self.numbers.get(name).copied();
        let close = number("chamfer").map_or(!has_truth, |chamfer| chamfer <= criterion.chamfer);
        let low = |(end, best): (f64, f64)| end <= criterion.rise * best;
        let loss = number("loss").zip(number("best_loss"));
        number("psnr").is_some() && close && loss.is_none_or(low)
    }

    /// The identity of this result. Two sweeps may list the same parameters in different orders and
    /// under short or long names.
    pub fn key(&self) -> ResultKey {
        let mut values: Settings = self
            .values
            .iter()
            .map(|(key, value)| (long_name(key).to_owned(), value.clone()))
            .collect();
        values.sort();
        (self.data.clone(), self.seed, values)
    }

    /// The value of a parameter; empty if there is no such parameter.
    pub fn value(&self, parameter: &str) -> &str {
        self.values.iter().find(|(k, _)| k == parameter).map_or("", |(_, v)| v)
    }

    /// Whether a metric is known.
    pub fn has(&self, metric: &Metric) -> bool {
        self.numbers.contains_key(metric.name)
    }

    /// Field evaluations of the fit in units of one value. This cost does not depend on the speed
    /// of the machine. Single and double precision are counted alike.
    pub fn passes(&self) -> Option<f64> {
        COSTS.iter().map(|(name, cost)| Some(cost * self.numbers.get(*name)?)).sum()
    }

    /// A metric; its worst number if it is unknown.
    pub fn number(&self, metric: &Metric) -> f64 {
        self.numbers.get(metric.name).copied().unwrap_or(metric.worst)
    }
}

/// The known numbers of a metric.
pub(crate) fn known_numbers(results: &[&CellResult], name: &str) -> Vec<f64> {
    results.iter().filter_map(|r| r.numbers.get(name).copied()).collect()
}

/// Settings as reports show them: `gamma = 3.0, top_k = 7`.
pub(crate) fn describe(settings: &[(String, String)]) -> String {
    settings.iter().map(|(k, v)| format!("{k} = {v}")).collect::<Vec<_>>().join(", ")
}

/// The result in a cell's folder, or `None` if the cell is not finished.
pub fn finished(folder: &Path) -> Option<CellResult> {
    serde_json::from_str(&read_text(&folder.join("result.json")).ok()?).ok()
}
