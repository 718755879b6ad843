//! What a sweep file says: parameters with their values, data sets, budget, repeats, and what is
//! asked of the results.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use toml::Value;

use super::refusal::Refusal;
use super::tables::{Claim, Converged, Data, GradientTest, Kind, Limits, Profile};

/// A sweep as its file has it.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sweep {
    /// One line.
    pub(super) title: String,
    /// What is asked, for the report.
    #[serde(default)]
    pub(super) about: String,
    /// The package whose binary of the same name (`dsdf` for `app`) runs the cells.
    #[serde(default = "app")]
    pub(super) package: String,
    /// How it is built.
    #[serde(default)]
    pub(super) profile: Profile,
    /// Iterations of every fit.
    #[serde(default)]
    pub(super) iterations: Option<u64>,
    /// Wall time of every fit in its stead, as `dsdf fit --time` has it; results then differ from
    /// run to run.
    #[serde(default)]
    pub(super) time: Option<String>,
    /// A repeat each.
    pub(super) seeds: Vec<u64>,
    /// The parameters of the rows and columns of tables and pictures; the first two otherwise.
    #[serde(default)]
    pub(super) rows: Option<String>,
    #[serde(default)]
    pub(super) columns: Option<String>,
    /// What the report shows, of [`super::results::METRICS`]; all otherwise.
    #[serde(default)]
    pub(super) metrics: Vec<String>,
    #[serde(default)]
    pub(super) limits: Limits,
    #[serde(default)]
    pub(super) converged: Converged,
    #[serde(default)]
    pub(super) gradient: GradientTest,
    /// Options of `dsdf fit` that all cells share, by their names with underscores.
    #[serde(default)]
    pub(super) fixed: BTreeMap<String, Value>,
    /// Options of `dsdf fit` with their values: the grid.
    pub(super) parameters: toml::map::Map<String, Value>,
    /// What is reconstructed.
    pub(super) data: Vec<Data>,
    /// What the results are held against.
    #[serde(default)]
    pub(super) claim: Vec<Claim>,
}

fn app() -> String {
    "app".to_owned()
}

/// One fit of a sweep.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// The data set's place in the sweep.
    pub(super) data: usize,
    /// The parameters, in the sweep's order.
    pub(super) values: Vec<(String, String)>,
    pub(super) seed: u64,
    /// A name for folders: data set, values, seed.
    pub(super) name: String,
}

/// Bytes of a cell's name: systems allow 255 for that of a folder.
const NAME: usize = 240;

/// The sweeps that come with the command.
pub(super) const SHIPPED: [(&str, &str); 7] = [
    ("k-gamma", include_str!("../../../xtask/sweeps/k-gamma.toml")),
    ("high-gamma", include_str!("../../../xtask/sweeps/high-gamma.toml")),
    ("steps-epsilon", include_str!("../../../xtask/sweeps/steps-epsilon.toml")),
    ("steps-refined", include_str!("../../../xtask/sweeps/steps-refined.toml")),
    ("filters", include_str!("../../../xtask/sweeps/filters.toml")),
    ("precision", include_str!("../../../xtask/sweeps/precision.toml")),
    ("smoke", include_str!("../../../xtask/sweeps/smoke.toml")),
];

/// A shipped sweep's name as it is, a file's from the root.
pub(super) fn absolute(name: &str) -> std::io::Result<String> {
    if SHIPPED.iter().any(|(known, _)| *known == name) {
        return Ok(name.to_owned());
    }
    Ok(std::path::absolute(name)?.to_string_lossy().into_owned())
}

/// A value as a flag has it.
pub(super) fn text(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        // 1e-8, not 0.00000001.
        Value::Float(v) if *v != 0.0 && !(1e-3..1e15).contains(&v.abs()) => format!("{v:e}"),
        other => other.to_string(),
    }
}

impl Sweep {
    /// What the cells depend on: not what is said of them.
    pub(super) fn identity(&self) -> Sweep {
        Sweep {
            title: String::new(),
            about: String::new(),
            rows: None,
            columns: None,
            metrics: Vec::new(),
            converged: Converged::default(),
            claim: Vec::new(),
            ..self.clone()
        }
    }

    /// Reads a shipped sweep or a file; also the folder that its own paths start from.
    pub(super) fn load(name: &str) -> Result<(Sweep, PathBuf), Refusal> {
        let (path, folder, source) = match SHIPPED.iter().find(|(known, _)| *known == name) {
            Some((_, source)) => {
                let folder = measure::dsdf::root().join("xtask/sweeps");
                (folder.join(format!("{name}.toml")), folder, (*source).to_owned())
            }
            None => {
                let path = PathBuf::from(name);
                let names = SHIPPED.map(|(known, _)| known).join(", ");
                let source = std::fs::read_to_string(&path).map_err(|e| {
                    Refusal::new(&path, "sweep", e, format!("a TOML file, or one of {names}"))
                })?;
                let folder = path.parent().map(Path::to_owned).unwrap_or_default();
                (path, folder, source)
            }
        };
        let sweep: Sweep = toml::from_str(&source).map_err(|e| {
            let line = e.span().map_or(0, |span| source[..span.start].matches('\n').count() + 1);
            Refusal::new(
                &path,
                format!("line {line}"),
                e.message().replace('\n', " "),
                "a sweep (see docs/ablate.md)",
            )
        })?;
        sweep.check(&path)?;
        Ok((sweep, folder))
    }

    fn check(&self, path: &Path) -> Result<(), Refusal> {
        let refuse = |field: String, found: String, expected: &str| {
            Err(Refusal::new(path, field, found, expected))
        };
        let lines = [("title", &self.title)]
            .into_iter()
            .chain(self.claim.iter().map(|c| ("claim.text", &c.text)));
        if let Some((field, odd)) =
            lines.into_iter().find(|(_, text)| text.chars().any(char::is_control))
        {
            return refuse(field.into(), format!("{odd:?}"), "one line");
        }
        let word = |key: &String| {
            !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        };
        for (table, key) in self
            .fixed
            .keys()
            .map(|k| ("fixed", k))
            .chain(self.parameters.keys().map(|k| ("parameters", k)))
        {
            if !word(key) {
                return refuse(
                    format!("{table}.{key:?}"),
                    format!("{key:?}"),
                    "letters, digits and underscores",
                );
            }
        }
        if self.parameters.is_empty() {
            return refuse(
                "parameters".into(),
                "none".into(),
                "one or more, each with a list of values",
            );
        }
        for (key, values) in &self.parameters {
            let Some(list) = values.as_array() else {
                return refuse(format!("parameters.{key}"), values.to_string(), "a list of values");
            };
            if list.is_empty() {
                return refuse(format!("parameters.{key}"), "[]".into(), "one value or more");
            }
            let plain = |v: &&Value| !(v.is_integer() || v.is_float() || v.is_str() || v.is_bool());
            if let Some(odd) = list.iter().find(plain) {
                return refuse(
                    format!("parameters.{key}"),
                    odd.to_string(),
                    "numbers, strings or booleans",
                );
            }
            let texts: Vec<String> = list.iter().map(text).collect();
            if let Some(odd) = texts.iter().find(|text| text.chars().any(char::is_control)) {
                return refuse(format!("parameters.{key}"), format!("{odd:?}"), "printable text");
            }
            let same = |a: &String, b: &String| {
                a == b || a.parse::<f64>().is_ok_and(|a| b.parse() == Ok(a))
            };
            if let Some(twice) =
                texts.iter().enumerate().find(|(i, t)| texts[..*i].iter().any(|o| same(o, t)))
            {
                return refuse(
                    format!("parameters.{key}"),
                    format!("{} twice", twice.1),
                    "different values",
                );
            }
        }
        if self.seeds.is_empty() {
            return refuse("seeds".into(), "[]".into(), "one or more");
        }
        if let Some((_, twice)) =
            self.seeds.iter().enumerate().find(|(i, seed)| self.seeds[..*i].contains(seed))
        {
            return refuse("seeds".into(), format!("{twice} twice"), "different seeds");
        }
        let positive = [
            ("limits.seconds", self.limits.seconds),
            ("limits.mebibytes", self.limits.mebibytes),
            ("converged.chamfer", self.converged.chamfer),
            ("converged.rise", self.converged.rise),
        ];
        if let Some((field, odd)) = positive.into_iter().find(|(_, v)| !(*v > 0.0 && v.is_finite()))
        {
            return refuse(field.into(), odd.to_string(), "a number above 0");
        }
        if self.rows.is_some() && self.rows == self.columns {
            return refuse("columns".into(), "the parameter of the rows".into(), "another one");
        }
        if self.data.is_empty() {
            return refuse("data".into(), "none".into(), "one data set or more");
        }
        let preset = self.parameters.contains_key("preset") || self.fixed.contains_key("preset");
        match (self.iterations, &self.time) {
            (Some(_), Some(_)) => {
                return refuse("iterations".into(), "iterations and time".into(), "one of them");
            }
            (None, None) if !preset => {
                return refuse(
                    "iterations".into(),
                    "neither iterations nor time nor a preset".into(),
                    "one of them",
                );
            }
            _ => {}
        }
        for (i, data) in self.data.iter().enumerate() {
            if data.scene.is_some() == data.dataset.is_some() {
                return refuse(
                    format!("data.{}", data.name),
                    "scene and dataset, or neither".into(),
                    "one of them",
                );
            }
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            if data.name.is_empty() || !data.name.chars().all(plain) {
                return refuse("data.name".into(), data.name.clone(), "letters, digits, - and _");
            }
            if self.data[..i].iter().any(|other| other.name == data.name) {
                return refuse(
                    "data.name".into(),
                    format!("{} twice", data.name),
                    "different names",
                );
            }
        }
        for (field, name) in [("rows", &self.rows), ("columns", &self.columns)] {
            if let Some(name) = name.as_ref().filter(|name| !self.parameters.contains_key(*name)) {
                return refuse(field.into(), name.clone(), "a key of parameters");
            }
        }
        if let Some(odd) = self.metrics.iter().find(|m| super::results::metric(m).is_none()) {
            return refuse("metrics".into(), odd.clone(), &super::results::metric_names());
        }
        let test = &self.gradient;
        if test.size == 0 || test.spp == 0 || test.runs < 2 {
            return refuse(
                "gradient".into(),
                format!("{test:?}"),
                "size and spp of 1 or more, 2 runs or more",
            );
        }
        if let Some(cell) = self.cells().iter().find(|cell| cell.name.len() > NAME) {
            let found = format!("a cell's name of {} bytes", cell.name.len());
            return refuse(
                "parameters".into(),
                found,
                &format!("{NAME} or less, for folders: fewer parameters or shorter values"),
            );
        }
        self.check_claims(path)
    }

    fn check_claims(&self, path: &Path) -> Result<(), Refusal> {
        for claim in &self.claim {
            let refuse = |found: String, expected: String| {
                Err(Refusal::new(path, format!("claim {:?}", claim.text), found, expected))
            };
            if super::results::metric(&claim.metric).is_none() {
                return refuse(claim.metric.clone(), super::results::metric_names());
            }
            let mentioned = claim.values.iter().chain(&claim.than).map(|v| (&claim.parameter, v));
            for (parameter, value) in mentioned.chain(&claim.only) {
                if !self.values(parameter).contains(&text(value)) {
                    return refuse(
                        format!("{parameter} = {value}"),
                        "a parameter and a value of the grid".into(),
                    );
                }
            }
            if claim.than.is_none() && claim.kind != Kind::Best {
                return refuse("no value to compare with".into(), "than = ...".into());
            }
            if !(claim.margin >= 0.0 && claim.margin.is_finite()) {
                return refuse(format!("margin = {}", claim.margin), "0 or more".into());
            }
            if claim.kind == Kind::Best && claim.values.len() != 1 {
                return refuse(format!("{} values", claim.values.len()), "one".into());
            }
            if claim.than.as_ref().is_some_and(|than| claim.values.contains(than)) {
                return refuse(
                    "a value compared with itself".into(),
                    "another value for than".into(),
                );
            }
            if matches!(claim.metric.as_str(), "chamfer" | "f_score")
                && claim.kind != Kind::OftenDiverges
                && let Some(data) = self.data.iter().find(|data| !data.has_truth())
            {
                let found = format!("{} of {}", claim.metric, data.name);
                return refuse(found, "a metric that needs no true surface, or mesh = ...".into());
            }
            if claim.values.is_empty() {
                return refuse("no values".into(), "values = [...]".into());
            }
        }
        Ok(())
    }

    /// The values of a parameter, as flags have them.
    pub(super) fn values(&self, parameter: &str) -> Vec<String> {
        let list = self.parameters.get(parameter).and_then(Value::as_array);
        list.map_or_else(Vec::new, |list| list.iter().map(text).collect())
    }

    /// The parameters of rows and columns.
    pub(super) fn axes(&self) -> (String, Option<String>) {
        let first =
            |not: Option<&String>| self.parameters.keys().find(|k| Some(*k) != not).cloned();
        let rows = self.rows.clone().or_else(|| first(self.columns.as_ref())).unwrap_or_default();
        let columns = self.columns.clone().or_else(|| first(Some(&rows)));
        // One parameter makes one column.
        if rows.is_empty() { (columns.unwrap_or_default(), None) } else { (rows, columns) }
    }

    /// All cells: the grid for every data set and seed.
    pub(super) fn cells(&self) -> Vec<Cell> {
        let mut grid: Vec<Vec<(String, String)>> = vec![Vec::new()];
        for key in self.parameters.keys() {
            let extend = |row: &Vec<(String, String)>, value: String| {
                row.iter().cloned().chain([(key.clone(), value)]).collect::<Vec<_>>()
            };
            grid = grid
                .iter()
                .flat_map(|row| self.values(key).into_iter().map(move |v| extend(row, v)))
                .collect();
        }
        let mut cells = Vec::new();
        // Repeats outermost: a sweep that is stopped half-way has all of the grid.
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

    /// The flags of `dsdf fit` for a cell, but for paths.
    pub(super) fn flags(&self, cell: &Cell) -> Vec<String> {
        let fixed = self.fixed.iter().map(|(key, value)| (key.clone(), text(value)));
        let mut flags: Vec<String> =
            fixed.chain(cell.values.iter().cloned()).flat_map(flag).collect();
        flags.extend(flag(("seed".to_owned(), cell.seed.to_string())));
        flags.extend(
            self.iterations.iter().flat_map(|n| flag(("iterations".to_owned(), n.to_string()))),
        );
        flags.extend(self.time.iter().flat_map(|t| flag(("time".to_owned(), t.clone()))));
        flags
    }

    /// The value of an option in a cell, if the sweep says one.
    pub(super) fn setting(&self, cell: &Cell, key: &str) -> Option<String> {
        let own = cell.values.iter().find(|(k, _)| k == key).map(|(_, v)| v.clone());
        own.or_else(|| self.fixed.get(key).map(text))
    }
}

/// The method's own names of some options.
const ALIASES: [(&str, &str); 3] = [("k", "top_k"), ("N", "steps"), ("spp", "edge_rays")];

/// The program's name of an option.
pub(super) fn long_name(key: &str) -> &str {
    ALIASES.iter().find(|(short, _)| *short == key).map_or(key, |(_, long)| long)
}

/// `--top-k=7` of `top_k` and 7; a switch for a boolean.
pub(super) fn flag((key, value): (String, String)) -> Vec<String> {
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
