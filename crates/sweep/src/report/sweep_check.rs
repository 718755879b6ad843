//! Checks of a sweep file that need neither the program nor the data.

use std::collections::{BTreeMap, HashSet};
use std::hash::Hash;
use std::path::Path;

use toml::Value;

use crate::report::metrics::{metric, metric_names};
use crate::report::options::text;
use crate::report::schema::{Claim, ClaimKind};
use crate::report::sweep::Sweep;
use files::InputError;

/// Longest name of a cell, in bytes. Systems allow 255 for the name of a folder.
const NAME: usize = 240;

/// The most cells of a sweep: at a minute each, they take a week.
const MOST_CELLS: usize = 10_000;

/// A wrong field: its place, the value found, and the expected values.
type Wrong = (String, String, String);

fn wrong(
    field: impl Into<String>,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> Result<(), Wrong> {
    Err((field.into(), found.into(), expected.into()))
}

/// Whether the text holds a line break or another control character.
fn has_control(text: &str) -> bool {
    text.chars().any(char::is_control)
}

/// The first item whose key occurs a second time.
fn repeated<T, K: Hash + Eq>(items: &[T], key: impl Fn(&T) -> K) -> Option<&T> {
    let mut known = HashSet::new();
    items.iter().find(|item| !known.insert(key(item)))
}

impl Sweep {
    /// Refuses the first wrong field of a sweep file.
    pub(crate) fn check(&self, path: &Path) -> Result<(), InputError> {
        self.check_texts()
            .and_then(|()| self.check_count())
            .and_then(|()| self.check_keys())
            .and_then(|()| self.check_parameters())
            .and_then(|()| self.check_settings())
            .and_then(|()| self.check_seeds())
            .and_then(|()| self.check_numbers())
            .and_then(|()| self.check_axes_differ())
            .and_then(|()| self.check_budget())
            .and_then(|()| self.check_data())
            .and_then(|()| self.check_report())
            .and_then(|()| self.check_mesh_resolution())
            .and_then(|()| self.check_gradient_test())
            .and_then(|()| self.check_names())
            .and_then(|()| self.claim.iter().try_for_each(|claim| self.check_claim(claim)))
            .map_err(|(field, found, expected)| InputError::new(path, field, found, expected))
    }

    /// The title and the claims' texts have one line each.
    fn check_texts(&self) -> Result<(), Wrong> {
        let claims = self.claim.iter().map(|c| ("claim.text", &c.text));
        let mut lines = [("title", &self.title)].into_iter().chain(claims);
        match lines.find(|(_, text)| has_control(text)) {
            Some((field, odd)) => wrong(field, format!("{odd:?}"), "one line"),
            None => Ok(()),
        }
    }

    /// The number of cells is bounded, before they are listed.
    fn check_count(&self) -> Result<(), Wrong> {
        let values = self.parameters.values().map(|v| v.as_array().map_or(1, Vec::len));
        let lists = values.chain([self.seeds.len(), self.data.len()]);
        // An empty list is reported as such later.
        let count = lists.fold(1usize, |count, length| count.saturating_mul(length.max(1)));
        if count > MOST_CELLS {
            return wrong("parameters", format!("{count} cells"), format!("at most {MOST_CELLS}"));
        }
        Ok(())
    }

    /// Options have names with underscores.
    fn check_keys(&self) -> Result<(), Wrong> {
        let word = |key: &str| {
            !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        };
        let fixed = self.fixed.keys().map(|k| ("fixed", k));
        let inner = self.settings.values().flat_map(BTreeMap::values).flat_map(BTreeMap::keys);
        let parameters = self.parameters.keys().map(|k| ("parameters", k));
        let mut keys = fixed.chain(parameters).chain(inner.map(|k| ("settings", k)));
        match keys.find(|(_, key)| !word(key)) {
            Some((table, key)) => wrong(
                format!("{table}.{key:?}"),
                format!("{key:?}"),
                "letters, digits and underscores",
            ),
            None => Ok(()),
        }
    }

    fn check_parameters(&self) -> Result<(), Wrong> {
        if self.parameters.is_empty() {
            return wrong("parameters", "none", "one or more, each with a list of values");
        }
        self.parameters.iter().try_for_each(|(key, values)| {
            check_values(values)
                .or_else(|(found, expected)| wrong(format!("parameters.{key}"), found, expected))
        })
    }

    /// Every table of settings is a parameter, with options for each value of its.
    fn check_settings(&self) -> Result<(), Wrong> {
        for (key, settings) in &self.settings {
            let (field, values) = (format!("settings.{key}"), self.values(key));
            if values.is_empty() {
                return wrong(field, key, "a key of parameters");
            }
            if let Some(odd) = values.iter().find(|value| !settings.contains_key(*value)) {
                return wrong(field, format!("nothing for {odd}"), "a table for each value");
            }
            if let Some(odd) = settings.keys().find(|value| !values.contains(value)) {
                return wrong(field, odd, format!("one of {}", values.join(", ")));
            }
        }
        Ok(())
    }

    fn check_seeds(&self) -> Result<(), Wrong> {
        if self.seeds.is_empty() {
            return wrong("seeds", "[]", "one or more");
        }
        match repeated(&self.seeds, |seed| *seed) {
            Some(twice) => wrong("seeds", format!("{twice} twice"), "different seeds"),
            None => Ok(()),
        }
    }

    /// Limits and thresholds are positive.
    fn check_numbers(&self) -> Result<(), Wrong> {
        let positive = [
            ("limits.seconds", self.limits.seconds),
            ("limits.mebibytes", self.limits.mebibytes),
            ("converged.chamfer", self.converged.chamfer),
            ("converged.rise", self.converged.rise),
        ];
        match positive.into_iter().find(|(_, v)| !(*v > 0.0 && v.is_finite())) {
            Some((field, odd)) => wrong(field, odd.to_string(), "a number above 0"),
            None => Ok(()),
        }
    }

    fn check_axes_differ(&self) -> Result<(), Wrong> {
        if self.rows.is_some() && self.rows == self.columns {
            return wrong("columns", "the parameter of the rows", "another one");
        }
        Ok(())
    }

    /// There is a data set, and the fits end: by iterations, time or a preset.
    fn check_budget(&self) -> Result<(), Wrong> {
        if self.data.is_empty() {
            return wrong("data", "none", "one data set or more");
        }
        let preset = self.parameters.contains_key("preset") || self.fixed.contains_key("preset");
        match (self.iterations, &self.time) {
            (Some(_), Some(_)) => wrong("iterations", "iterations and time", "one of them"),
            (None, None) if !preset => {
                wrong("iterations", "neither iterations nor time nor a preset", "one of them")
            }
            _ => Ok(()),
        }
    }

    fn check_data(&self) -> Result<(), Wrong> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        for (i, data) in self.data.iter().enumerate() {
            if data.scene.is_some() == data.dataset.is_some() {
                let field = format!("data.{}", data.name);
                return wrong(field, "scene and dataset, or neither", "one of them");
            }
            if data.name.is_empty() || !data.name.chars().all(plain) {
                return wrong("data.name", data.name.clone(), "letters, digits, - and _");
            }
            if self.data[..i].iter().any(|other| other.name == data.name) {
                return wrong("data.name", format!("{} twice", data.name), "different names");
            }
        }
        Ok(())
    }

    /// Rows, columns and metrics of the report exist.
    fn check_report(&self) -> Result<(), Wrong> {
        for (field, name) in [("rows", &self.rows), ("columns", &self.columns)] {
            if let Some(name) = name.as_ref().filter(|name| !self.parameters.contains_key(*name)) {
                return wrong(field, name, "a key of parameters");
            }
        }
        match self.metrics.iter().find(|name| metric(name).is_none()) {
            Some(odd) => wrong("metrics", odd, metric_names()),
            None => Ok(()),
        }
    }

    fn check_mesh_resolution(&self) -> Result<(), Wrong> {
        if !(8..=2048).contains(&self.mesh_resolution) {
            return wrong("mesh_resolution", self.mesh_resolution.to_string(), "8 to 2048");
        }
        Ok(())
    }

    /// The variance of a gradient needs two runs; a sweep with none has no gradient test.
    fn check_gradient_test(&self) -> Result<(), Wrong> {
        let test = &self.gradient;
        if test.runs == 1 {
            return wrong("gradient.runs", "1", "0, or 2 or more");
        }
        let least = [("size", test.size, 1), ("spp", test.spp, 1)];
        match least.into_iter().find(|(_, found, least)| found < least) {
            Some((key, found, least)) => {
                wrong(format!("gradient.{key}"), found.to_string(), format!("{least} or more"))
            }
            None => Ok(()),
        }
    }

    /// The cells' names are short enough for folders.
    fn check_names(&self) -> Result<(), Wrong> {
        match self.cells().iter().find(|cell| cell.name.len() > NAME) {
            Some(cell) => wrong(
                "parameters",
                format!("a cell's name of {} bytes", cell.name.len()),
                format!("{NAME} or less, for folders: fewer parameters or shorter values"),
            ),
            None => Ok(()),
        }
    }

    fn check_claim(&self, claim: &Claim) -> Result<(), Wrong> {
        self.check_claim_values(claim)
            .and_then(|()| check_comparison(claim))
            .and_then(|()| self.check_truth(claim))
            .or_else(|(found, expected)| wrong(format!("claim {:?}", claim.text), found, expected))
    }

    /// The metric, the parameters and the values of a claim are those of the sweep.
    fn check_claim_values(&self, claim: &Claim) -> Result<(), WrongValue> {
        if metric(&claim.metric).is_none() {
            return Err((claim.metric.clone(), metric_names()));
        }
        let mentioned = claim.values.iter().chain(&claim.than).map(|v| (&claim.parameter, v));
        for (parameter, value) in mentioned.chain(&claim.only) {
            if !self.values(parameter).contains(&text(value)) {
                let found = format!("{parameter} = {value}");
                return wrong_value(found, "a parameter and a value of the grid");
            }
        }
        Ok(())
    }

    /// A claim about distances to the true surface needs that surface, and a claim needs a value.
    fn check_truth(&self, claim: &Claim) -> Result<(), WrongValue> {
        if matches!(claim.metric.as_str(), "chamfer" | "f_score")
            && claim.kind != ClaimKind::OftenDiverges
            && let Some(data) = self.data.iter().find(|data| !data.has_truth())
        {
            let found = format!("{} of {}", claim.metric, data.name);
            return wrong_value(found, "a metric that needs no true surface, or mesh = ...");
        }
        if claim.values.is_empty() {
            return wrong_value("no values", "values = [...]");
        }
        Ok(())
    }
}

/// A wrong value: the value found, and the expected values.
type WrongValue = (String, String);

fn wrong_value(found: impl Into<String>, expected: &str) -> Result<(), WrongValue> {
    Err((found.into(), expected.to_owned()))
}

/// A parameter has a list of different printable numbers, strings or booleans.
fn check_values(values: &Value) -> Result<(), WrongValue> {
    let Some(list) = values.as_array() else {
        return wrong_value(values.to_string(), "a list of values");
    };
    if list.is_empty() {
        return wrong_value("[]", "one value or more");
    }
    let compound = |v: &&Value| !(v.is_integer() || v.is_float() || v.is_str() || v.is_bool());
    if let Some(odd) = list.iter().find(compound) {
        return wrong_value(odd.to_string(), "numbers, strings or booleans");
    }
    let texts: Vec<String> = list.iter().map(text).collect();
    if let Some(odd) = texts.iter().find(|text| has_control(text)) {
        return wrong_value(format!("{odd:?}"), "printable text");
    }
    // 3 and 3.0 are the same value, and 0 and -0.
    let number = |text: &String| text.parse::<f64>().map(|v| (v + 0.0).to_string());
    match repeated(&texts, |text| number(text).unwrap_or_else(|_| text.clone())) {
        Some(twice) => wrong_value(format!("{twice} twice"), "different values"),
        None => Ok(()),
    }
}

/// A claim compares with another value, except `best`, which is about one value.
fn check_comparison(claim: &Claim) -> Result<(), WrongValue> {
    if claim.than.is_none() && claim.kind != ClaimKind::Best {
        return wrong_value("no value to compare with", "than = ...");
    }
    if !(claim.margin >= 0.0 && claim.margin.is_finite()) {
        return wrong_value(format!("margin = {}", claim.margin), "0 or more");
    }
    if claim.kind == ClaimKind::Best && claim.values.len() != 1 {
        return wrong_value(format!("{} values", claim.values.len()), "one");
    }
    if claim.than.as_ref().is_some_and(|than| claim.values.contains(than)) {
        return wrong_value("a value compared with itself", "another value for than");
    }
    Ok(())
}
