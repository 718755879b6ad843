//! A sweep: its file, its cells, and the options of `dsdf fit` for each cell.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use toml::Value;

use crate::refusal::Refusal;
use crate::schema::{Claim, Convergence, DataSet, GradientTest, Limits, Profile};

/// Parameters with their values as text, in order.
pub(crate) type Settings = Vec<(String, String)>;

/// The content of a sweep file.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sweep {
    /// The report's title, one line.
    pub(crate) title: String,
    /// The question of the sweep, for the report.
    #[serde(default)]
    pub(crate) about: String,
    /// The package whose binary of the same name (`dsdf` for `app`) runs the cells.
    #[serde(default = "app")]
    pub(crate) package: String,
    /// The build profile of that binary.
    #[serde(default)]
    pub(crate) profile: Profile,
    /// Iterations of every fit.
    #[serde(default)]
    pub(crate) iterations: Option<u64>,
    /// Wall time of every fit, as in `dsdf fit --time`, in place of iterations. Results then differ
    /// from run to run.
    #[serde(default)]
    pub(crate) time: Option<String>,
    /// The seeds: every combination of values is fitted once with each.
    pub(crate) seeds: Vec<u64>,
    /// The parameter of the rows in tables and pictures; by default the first one.
    #[serde(default)]
    pub(crate) rows: Option<String>,
    /// The parameter of the columns; by default the second one.
    #[serde(default)]
    pub(crate) columns: Option<String>,
    /// The metrics in the report, of [`crate::metrics::METRICS`]; by default all.
    #[serde(default)]
    pub(crate) metrics: Vec<String>,
    /// The limits of each process.
    #[serde(default)]
    pub(crate) limits: Limits,
    /// The criterion of convergence.
    #[serde(default)]
    pub(crate) converged: Convergence,
    /// The gradient test.
    #[serde(default)]
    pub(crate) gradient: GradientTest,
    /// Options of `dsdf fit` that all cells share, by their names with underscores.
    #[serde(default)]
    pub(crate) fixed: BTreeMap<String, Value>,
    /// The grid: options of `dsdf fit`, each with a list of values.
    pub(crate) parameters: toml::map::Map<String, Value>,
    /// The data sets.
    pub(crate) data: Vec<DataSet>,
    /// The claims that the report judges.
    #[serde(default)]
    pub(crate) claim: Vec<Claim>,
}

fn app() -> String {
    "app".to_owned()
}

/// One fit of a sweep.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// The index of the data set in the sweep.
    pub(crate) data: usize,
    /// The parameters with their values, in the sweep's order.
    pub(crate) values: Settings,
    /// The seed.
    pub(crate) seed: u64,
    /// The name of the cell's folder, from data set, values and seed.
    pub(crate) name: String,
}

/// The sweeps that come with the command.
pub(crate) const SHIPPED: [(&str, &str); 7] = [
    ("k-gamma", include_str!("../../../xtask/sweeps/k-gamma.toml")),
    ("high-gamma", include_str!("../../../xtask/sweeps/high-gamma.toml")),
    ("steps-epsilon", include_str!("../../../xtask/sweeps/steps-epsilon.toml")),
    ("steps-refined", include_str!("../../../xtask/sweeps/steps-refined.toml")),
    ("filters", include_str!("../../../xtask/sweeps/filters.toml")),
    ("precision", include_str!("../../../xtask/sweeps/precision.toml")),
    ("smoke", include_str!("../../../xtask/sweeps/smoke.toml")),
];

/// The name of a shipped sweep unchanged, or the absolute path of a sweep file.
pub(crate) fn absolute(name: &str) -> std::io::Result<String> {
    if SHIPPED.iter().any(|(known, _)| *known == name) {
        return Ok(name.to_owned());
    }
    Ok(std::path::absolute(name)?.to_string_lossy().into_owned())
}

/// A value as the text of an option.
pub(crate) fn text(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        // 1e-8, not 0.00000001.
        Value::Float(v) if *v != 0.0 && !(1e-3..1e15).contains(&v.abs()) => format!("{v:e}"),
        other => other.to_string(),
    }
}

impl Sweep {
    /// The part of a sweep that the cells depend on: a folder may be continued after a change of
    /// all the rest.
    pub(crate) fn identity(&self) -> Sweep {
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

    /// Reads a shipped sweep or a file. Returns it with its base folder: the paths in the file are
    /// relative to that folder.
    pub(crate) fn load(name: &str) -> Result<(Sweep, PathBuf), Refusal> {
        let (path, source) = source(name)?;
        let sweep: Sweep = toml::from_str(&source).map_err(|e| {
            let line = e.span().map_or(0, |span| source[..span.start].matches('\n').count() + 1);
            let message = e.message().replace('\n', " ");
            Refusal::new(&path, format!("line {line}"), message, "a sweep (see docs/ablate.md)")
        })?;
        sweep.check(&path)?;
        Ok((sweep, path.parent().map(Path::to_owned).unwrap_or_default()))
    }

    /// The values of a parameter as the texts of options.
    pub(crate) fn values(&self, parameter: &str) -> Vec<String> {
        let list = self.parameters.get(parameter).and_then(Value::as_array);
        list.map_or_else(Vec::new, |list| list.iter().map(text).collect())
    }

    /// The parameters of the rows and of the columns; a sweep over one parameter has no columns.
    pub(crate) fn axes(&self) -> (String, Option<String>) {
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
    pub(crate) fn cells(&self) -> Vec<Cell> {
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
    pub(crate) fn flags(&self, cell: &Cell) -> Vec<String> {
        let fixed = self.fixed.iter().map(|(key, value)| (key.clone(), text(value)));
        let budget =
            [("iterations", self.iterations.map(|n| n.to_string())), ("time", self.time.clone())];
        let budget = budget.into_iter().filter_map(|(key, v)| Some((key.to_owned(), v?)));
        fixed
            .chain(cell.values.iter().cloned())
            .chain([("seed".to_owned(), cell.seed.to_string())])
            .chain(budget)
            .flat_map(flag)
            .collect()
    }

    /// The value of an option in a cell, if the sweep sets it.
    pub(crate) fn setting(&self, cell: &Cell, key: &str) -> Option<String> {
        let own = cell.values.iter().find(|(k, _)| k == key).map(|(_, v)| v.clone());
        own.or_else(|| self.fixed.get(key).map(text))
    }
}

/// The path and the text of a shipped sweep or a file.
fn source(name: &str) -> Result<(PathBuf, String), Refusal> {
    if let Some((_, source)) = SHIPPED.iter().find(|(known, _)| *known == name) {
        let folder = measure::dsdf::root().join("xtask/sweeps");
        return Ok((folder.join(format!("{name}.toml")), (*source).to_owned()));
    }
    let path = PathBuf::from(name);
    let source = std::fs::read_to_string(&path).map_err(|e| {
        let names = SHIPPED.map(|(known, _)| known).join(", ");
        Refusal::new(&path, "sweep", e, format!("a TOML file, or one of {names}"))
    })?;
    Ok((path, source))
}

/// Short names of options, as in the publication, with the long names of the program.
const ALIASES: [(&str, &str); 3] = [("k", "top_k"), ("N", "steps"), ("spp", "edge_rays")];

/// The program's name of an option, with underscores.
pub(crate) fn long_name(key: &str) -> &str {
    ALIASES.iter().find(|(short, _)| *short == key).map_or(key, |(_, long)| long)
}

/// An option of the command line: `--top-k=7` for `top_k` and 7. The value `true` gives a switch,
/// the value `false` nothing.
pub(crate) fn flag((key, value): (String, String)) -> Vec<String> {
    let name = format!("--{}", long_name(&key).replace('_', "-"));
    match value.as_str() {
        "true" => vec![name],
        "false" => Vec::new(),
        _ => vec![format!("{name}={value}")],
    }
}

#[cfg(test)]
#[path = "sweep_tests.rs"]
mod tests;
