//! A sweep: the content of its file, its cells, and the options of `dsdf fit` for each cell.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};
use toml::Value;

use crate::report::options::{Settings, flag, text};
use crate::report::schema::{Claim, Convergence, DataSet, GradientTest, Limits, Options, Profile};

/// The content of a sweep file.
///
/// [`Sweep::load`] checks it. A sweep that is deserialised otherwise is not checked.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// The report's title, one line.
    pub title: String,
    /// The question of the sweep, for the report.
    #[serde(default)]
    pub about: String,
    /// The package whose binary of the same name runs the cells. `app`, an older name of `dsdf`,
    /// is read as `dsdf`.
    #[serde(default = "dsdf", deserialize_with = "package")]
    pub package: String,
    /// The build profile of that binary.
    #[serde(default)]
    pub profile: Profile,
    /// Iterations of every fit.
    #[serde(default)]
    pub iterations: Option<u64>,
    /// Wall time of every fit, as in `dsdf fit --time`, in place of iterations. Results then differ
    /// from run to run.
    #[serde(default)]
    pub time: Option<String>,
    /// The seeds: every combination of values is fitted once with each.
    pub seeds: Vec<u64>,
    /// The parameter of the rows in tables and pictures; by default the first one.
    #[serde(default)]
    pub rows: Option<String>,
    /// The parameter of the columns; by default the second one.
    #[serde(default)]
    pub columns: Option<String>,
    /// The metrics in the report, of [`crate::report::metrics::METRICS`]; by default all.
    #[serde(default)]
    pub metrics: Vec<String>,
    /// The resolution of the mesh of each fit, as in `dsdf eval --resolution`; 128 by default,
    /// which is enough for Chamfer distances. The normals of a mesh are those of its faces: a
    /// coarse one is wrong about fine ridges.
    #[serde(default = "mesh_resolution")]
    pub mesh_resolution: u32,
    /// The limits of each process.
    #[serde(default)]
    pub limits: Limits,
    /// The criterion of convergence.
    #[serde(default)]
    pub converged: Convergence,
    /// The gradient test.
    #[serde(default)]
    pub gradient: GradientTest,
    /// Options of `dsdf fit` that all cells share, by their names with underscores.
    #[serde(default)]
    pub fixed: Options,
    /// The grid: options of `dsdf fit`, each with a list of values.
    pub parameters: toml::map::Map<String, Value>,
    /// Parameters that are no options: each of their values stands for some options.
    #[serde(default)]
    pub settings: BTreeMap<String, BTreeMap<String, Options>>,
    /// The data sets.
    pub data: Vec<DataSet>,
    /// The claims that the report judges.
    #[serde(default)]
    pub claim: Vec<Claim>,
}

fn dsdf() -> String {
    "dsdf".to_owned()
}

fn package<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    Ok(if name == "app" { dsdf() } else { name })
}

fn mesh_resolution() -> u32 {
    128
}

/// One fit of a sweep.
#[derive(Clone, Debug)]
pub struct Cell {
    /// The index of the data set in the sweep.
    pub data: usize,
    /// The parameters with their values, in the sweep's order.
    pub values: Settings,
    /// The seed.
    pub seed: u64,
    /// The name of the cell's folder, from data set, values and seed.
    pub name: String,
}

impl Sweep {
    /// The part of a sweep that the cells depend on: a folder may be continued after a change of
    /// all the rest.
    pub fn identity(&self) -> Sweep {
        Sweep {
            title: String::new(),
            about: String::new(),
            rows: None,
            columns: None,
            metrics: Vec::new(),
            converged: Convergence::default(),
            claim: Vec::new(),
            ..self.clone()
        }
    }

    /// The values of a parameter as the texts of options.
    pub fn values(&self, parameter: &str) -> Vec<String> {
        let list = self.parameters.get(parameter).and_then(Value::as_array);
        list.map_or_else(Vec::new, |list| list.iter().map(text).collect())
    }

    /// The parameters of the rows and of the columns; a sweep over one parameter has no columns.
    pub fn axes(&self) -> (String, Option<String>) {
        let first =
            |not: Option<&String>| self.parameters.keys().find(|k| Some(*k) != not).cloned();
        let rows = self.rows.clone().or_else(|| first(self.columns.as_ref())).unwrap_or_default();
        let columns = self.columns.clone().or_else(|| first(Some(&rows)));
        // One parameter makes one column.
        if rows.is_empty() { (columns.unwrap_or_default(), None) } else { (rows, columns) }
    }

    /// All combinations of the values of these parameters, the last parameter varying fastest.
    pub(crate) fn combinations<'a>(
        &self,
        parameters: impl Iterator<Item = &'a String>,
    ) -> Vec<Settings> {
        let mut all: Vec<Settings> = vec![Vec::new()];
        for key in parameters {
            let extend = |settings: &Settings, value: String| -> Settings {
                settings.iter().cloned().chain([(key.clone(), value)]).collect()
            };
            all = all
                .iter()
                .flat_map(|some| self.values(key).into_iter().map(move |v| extend(some, v)))
                .collect();
        }
        all
    }

    /// All cells: every combination of values for every data set and seed.
    ///
    /// The seed varies slowest, so that an interrupted sweep has the whole grid for some seeds.
    pub fn cells(&self) -> Vec<Cell> {
        let grid = self.combinations(self.parameters.keys());
        let mut cells = Vec::new();
        for &seed in &self.seeds {
            for (data, set) in self.data.iter().enumerate() {
                for values in &grid {
                    let settings: Vec<String> =
                        values.iter().map(|(k, v)| format!("{k}={v}")).collect();
                    let name = format!("{}.{}.seed={seed}", set.name, settings.join("."))
                        .replace(['/', ' '], "_");
                    cells.push(Cell { data, values: values.clone(), seed, name });
                }
            }
        }
        cells
    }

    /// The options of `dsdf fit` for a cell, without paths.
    pub fn flags(&self, cell: &Cell) -> Vec<String> {
        let fixed = self.fixed.iter().map(|(key, value)| (key.clone(), text(value)));
        let budget =
            [("iterations", self.iterations.map(|n| n.to_string())), ("time", self.time.clone())];
        let budget = budget.into_iter().filter_map(|(key, v)| Some((key.to_owned(), v?)));
        fixed
            .chain(self.options(cell))
            .chain([("seed".to_owned(), cell.seed.to_string())])
            .chain(budget)
            .flat_map(flag)
            .collect()
    }

    /// The options of the grid in a cell: its values, with the options in place of those that stand
    /// for some.
    pub fn options(&self, cell: &Cell) -> Settings {
        let options = |(key, value): &(String, String)| -> Settings {
            match self.settings.get(key).and_then(|settings| settings.get(value)) {
                Some(options) => options.iter().map(|(k, v)| (k.clone(), text(v))).collect(),
                None => vec![(key.clone(), value.clone())],
            }
        };
        cell.values.iter().flat_map(options).collect()
    }

    /// The value of an option in a cell, if the sweep sets it.
    pub fn setting(&self, cell: &Cell, key: &str) -> Option<String> {
        let own = self.options(cell).into_iter().find(|(k, _)| k == key).map(|(_, v)| v);
        own.or_else(|| self.fixed.get(key).map(text))
    }
}
