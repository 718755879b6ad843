//! Checks of a sweep that need the program or the data: its options, its package, its files.

use std::fmt::Display;
use std::path::Path;
use std::process::{Command, Output};

use crate::error::Error;
use crate::report::Sweep;
use crate::report::options::{flag, text};
use crate::report::schema::DataSet;
use files::InputError;

/// Options of `dsdf fit` that a sweep may not set, with the key or option to use instead.
const RESERVED: [(&str, &str); 13] = [
    ("help", "an option of a fit"),
    ("version", "an option of a fit"),
    ("check", "an option of a fit"),
    ("end_with", "an option of a fit"),
    ("stop_after", "iterations = N beside title"),
    ("seed", "seeds = [...] beside title"),
    ("iterations", "iterations = N beside title"),
    ("time", "time = \"...\" beside title"),
    ("threads", "--jobs"),
    ("output", "-o"),
    ("resume", "sweeps without it: the same command continues a sweep"),
    ("json", "sweeps without it: it is set"),
    ("quiet", "sweeps without it: it is set"),
];

/// Refuses a package that the workspace does not have.
pub(crate) fn check_package(sweep: &Sweep, file: &Path) -> Result<(), Error> {
    let packages = crate::measure::dsdf::packages()?;
    if !packages.contains(&sweep.package) {
        let expected = format!("one of {}", packages.join(", "));
        return Err(InputError::new(file, "package", &sweep.package, expected).into());
    }
    Ok(())
}

/// Refuses options that the program rejects: each value alone, then the combinations of all cells.
///
/// `dsdf fit --check` judges options without a fit.
pub(crate) fn check_options(sweep: &Sweep, file: &Path, binary: &Path) -> Result<(), Error> {
    check_binary(binary)?;
    for (key, value) in &sweep.fixed {
        check_option(file, "fixed", key, text(value), binary)?;
    }
    for key in sweep.parameters.keys().filter(|key| !sweep.settings.contains_key(*key)) {
        for value in sweep.values(key) {
            check_option(file, "parameters", key, value, binary)?;
        }
    }
    for (parameter, settings) in &sweep.settings {
        for (value, options) in settings {
            let table = format!("settings.{parameter}.{value}");
            options
                .iter()
                .try_for_each(|(key, v)| check_option(file, &table, key, text(v), binary))?;
        }
    }
    check_combinations(sweep, file, binary)
}

/// Refuses a program that cannot run, or does not take the options of a fit.
fn check_binary(binary: &Path) -> Result<(), Error> {
    let found = match rejection(binary, &["--no-such-option".to_owned()]) {
        Ok(Some(message)) if message.contains("--no-such-option") => return Ok(()),
        Ok(None) => "a program that accepts an unknown option".to_owned(),
        Ok(Some(message)) if message.is_empty() => "a program that says nothing".to_owned(),
        Ok(Some(message)) => message,
        Err(error) => error.to_string(),
    };
    Err(InputError::new(binary, "--binary", found, "a program like dsdf").into())
}

/// Refuses a value of an option in one of the sweep's tables.
fn check_option(
    file: &Path,
    table: &str,
    key: &String,
    value: String,
    binary: &Path,
) -> Result<(), Error> {
    let field = format!("{table}.{key}");
    if let Some((_, instead)) = RESERVED.iter().find(|(reserved, _)| reserved == key) {
        return Err(InputError::new(file, field, key, instead).into());
    }
    if key == "gradient_precision" {
        if value != "f32" && value != "f64" {
            return Err(InputError::new(file, field, value, "f32 or f64").into());
        }
        return Ok(());
    }
    // A switch that is off has no option: the switch itself is checked.
    let checked = if value == "false" { "true".to_owned() } else { value.clone() };
    let Some(message) = rejection(binary, &flag((key.clone(), checked)))? else { return Ok(()) };
    if message.contains("unexpected argument") {
        return Err(InputError::new(file, field, key, "an option of `dsdf fit`").into());
    }
    let (found, expected) = found_and_expected(value, &message);
    Err(InputError::new(file, field, found, expected).into())
}

/// The found and the expected value, from the program's message about an option's value.
///
/// Some messages end with the expected value, and some list the possible values. Of any other
/// message the reason follows the found value.
fn found_and_expected(value: String, message: &str) -> (String, String) {
    if let Some((_, expected)) = message.rsplit_once(" expected ") {
        return (value, expected.to_owned());
    }
    if let Some((_, list)) = message.split_once("[possible values: ") {
        let list = list.split(']').next().unwrap_or(list);
        return (value, format!("one of {list}"));
    }
    let reason = message.rsplit_once("': ").map_or(message, |(_, reason)| reason);
    (format!("{value} ({reason})"), "a value that `dsdf fit` accepts".to_owned())
}

/// Refuses values that the program takes alone but not together. Cells that differ in the seed only
/// are checked once.
fn check_combinations(sweep: &Sweep, file: &Path, binary: &Path) -> Result<(), Error> {
    let mut checked: Vec<Vec<String>> = Vec::new();
    for cell in sweep.cells() {
        let flags: Vec<String> =
            sweep.flags(&cell).into_iter().filter(|f| !f.starts_with("--gradient-")).collect();
        let settings: Vec<String> =
            flags.iter().filter(|f| !f.starts_with("--seed=")).cloned().collect();
        if checked.contains(&settings) {
            continue;
        }
        if let Some(message) = rejection(binary, &flags)? {
            let expected = "options that go together";
            return Err(InputError::new(file, cell.name, message, expected).into());
        }
        checked.push(settings);
    }
    Ok(())
}

/// Refuses data sets with missing or unsuitable files. `base` is the folder of their paths.
pub(crate) fn check_data(
    sweep: &Sweep,
    base: &Path,
    file: &Path,
    binary: &Path,
) -> Result<(), Error> {
    sweep.data.iter().try_for_each(|data| DataCheck { data, base, file }.run(binary))
}

/// The check of one data set.
struct DataCheck<'a> {
    data: &'a DataSet,
    base: &'a Path,
    /// The sweep's file, for refusals.
    file: &'a Path,
}

impl DataCheck<'_> {
    fn run(&self, binary: &Path) -> Result<(), Error> {
        let data = self.data;
        self.check_path("scene", &data.scene, "a file", Path::is_file)?;
        self.check_path("dataset", &data.dataset, "a folder", Path::is_dir)?;
        self.check_path("mesh", &data.mesh, "a file", Path::is_file)?;
        let is_mesh = |path: &String| path.ends_with(".ply") || path.ends_with(".obj");
        if let Some(mesh) = data.mesh.as_ref().filter(|path| !is_mesh(path)) {
            let expected = "a .ply or .obj file";
            return Err(InputError::new(self.file, self.field("mesh"), mesh, expected).into());
        }
        if let Some(dataset) = &data.dataset {
            self.inspect(&self.base.join(dataset), binary)?;
        }
        for (key, value) in [("views", data.views), ("size", data.size)] {
            if value == 0 {
                return Err(InputError::new(self.file, self.field(key), "0", "1 or more").into());
            }
        }
        Ok(())
    }

    fn field(&self, key: &str) -> String {
        format!("data.{}.{key}", self.data.name)
    }

    /// Refuses a path that is set and is not `expected`.
    fn check_path(
        &self,
        key: &str,
        path: &Option<String>,
        expected: &str,
        is_expected: fn(&Path) -> bool,
    ) -> Result<(), InputError> {
        match path.as_ref().map(|path| self.base.join(path)) {
            Some(path) if !is_expected(&path) => {
                Err(InputError::new(self.file, self.field(key), path.display(), expected))
            }
            _ => Ok(()),
        }
    }

    /// Refuses a folder that the program cannot read as a data set.
    fn inspect(&self, dataset: &Path, binary: &Path) -> Result<(), Error> {
        let output = Command::new(binary).args(["inspect", "--json"]).arg(dataset).output()?;
        if output.status.success() {
            return Ok(());
        }
        let (field, message) = (self.field("dataset"), message(&output));
        Err(of_message(self.file, field, &message, "a data set").into())
    }
}

/// Wrong input by the program's message. If the message names an expected value, that one is taken
/// in place of `expected`.
pub(crate) fn of_message(
    file: &Path,
    field: impl Display,
    message: &str,
    expected: &str,
) -> InputError {
    let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, expected));
    InputError::new(file, field, found, expected)
}

/// The program's message if it rejects these options of a fit.
fn rejection(binary: &Path, flags: &[String]) -> Result<Option<String>, Error> {
    let output =
        Command::new(binary).args(["fit", "--check", "-o", "unused"]).args(flags).output()?;
    Ok((!output.status.success()).then(|| message(&output)))
}

/// The message of a program that failed.
fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).trim().trim_start_matches("error: ").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_values_have_a_found_and_an_expected_part() {
        for (message, found, expected) in [
            ("arguments: N: found 0, expected 1 to 65536", "0", "1 to 65536"),
            ("invalid value '0' for '--a <A>': expected 1 or 2", "0", "1 or 2"),
            ("invalid value '0' for '--a <A>' [possible values: b, c]", "0", "one of b, c"),
            (
                "unexpected value '0' for '--a' found; no more were expected",
                "0 (unexpected value '0' for '--a' found; no more were expected)",
                "a value that `dsdf fit` accepts",
            ),
            (
                "invalid value '0' for '--a <A>': not a word",
                "0 (not a word)",
                "a value that `dsdf fit` accepts",
            ),
        ] {
            let parts = found_and_expected("0".to_owned(), message);
            assert_eq!(parts, (found.to_owned(), expected.to_owned()), "{message}");
        }
    }
}
