//! The resumption of a run from its checkpoint.

use std::path::Path;

use super::options::Fit;
use super::prepare_run::{absolute, refuse_without_checkpoint};
use crate::cli::common::{ARGUMENTS, FROM_RUN, Global, option_error};
use dataset::Dataset;
use files::InputError;
use fit::{RunCameras, RunFile, RunFolder, check_masks};

/// The options that a resumed run may change.
const BUDGET: [&str; 2] = ["time", "iterations"];

impl Fit {
    /// The data set and the `fit.toml` of the run to resume, with the budget of the command line if
    /// it has one, and the origin of its bounding sphere in words.
    pub(super) fn resumed_run(
        &self,
        global: &Global,
    ) -> anyhow::Result<(Dataset, RunFile, String)> {
        let mut file = RunFile::load(&self.output)?;
        refuse_without_checkpoint(&self.output)?;
        if self.options.time.is_some() || self.options.iterations.is_some() {
            (file.options.time, file.options.iterations) =
                (self.options.time, self.options.iterations);
        }
        file.options = file.options.with_schedule();
        let toml = RunFolder::new(&self.output).fit_toml();
        // The budget alone may be from the command line.
        let is_budget = |e: &InputError| BUDGET.contains(&e.field.as_str());
        file.options.validate(&toml, &global.registry).map_err(|e| {
            match is_budget(&e) && self.explicit.contains(&e.field) {
                true => option_error(&e.field, e.found, &e.expected),
                false => e,
            }
        })?;
        self.refuse_other_options(&file, &toml)?;
        self.take_place_of_dataset(&mut file, &toml)?;
        let dataset = file.read(None)?;
        if let Some(cameras) = RunCameras::load(&self.output)? {
            cameras.check_sizes(&dataset, &self.output)?;
        }
        check_masks(file.masks, &dataset, &toml)?;
        let dataset = file.prepare(dataset);
        Ok((dataset, file, FROM_RUN.to_owned()))
    }

    /// Refuses an option on the command line that differs from its value in `file`: the resumed run
    /// would ignore it. The budget may differ.
    fn refuse_other_options(&self, file: &RunFile, source: &Path) -> anyhow::Result<()> {
        let [given, kept] =
            [&self.options, &file.options].map(|options| toml::Table::try_from(options).map(flat));
        let (given, kept) = (given?, kept?);
        for (key, value) in given.into_iter().filter(|(key, _)| self.explicit.contains(key)) {
            if kept.get(&key) != Some(&value) && !BUDGET.contains(&key.as_str()) {
                let kept = kept.get(&key).map_or("nothing".to_owned(), ToString::to_string);
                let expected = format!("{kept}, as in {}", source.display());
                return Err(option_error(&key, value.to_string(), &expected).into());
            }
        }
        Ok(())
    }

    /// Takes the data set on the command line as the new place of that of the run: its views have
    /// the same names, which are checked when it is opened.
    ///
    /// # Errors
    /// If the run is of an earlier version and has no names: any other place is refused.
    fn take_place_of_dataset(&self, file: &mut RunFile, source: &Path) -> Result<(), InputError> {
        match &self.dataset {
            Some(path) if absolute(path) != absolute(&file.dataset) => {
                if file.views.is_none() {
                    let place = file.dataset.display();
                    let expected = format!("{place}, as in {}", source.display());
                    return Err(InputError::new(ARGUMENTS, "DATASET", path.display(), expected));
                }
                file.dataset = absolute(path);
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// The entries of a table and of its inner tables, each under its own key.
fn flat(table: toml::Table) -> toml::Table {
    let entries = table.into_iter().flat_map(|(key, value)| match value {
        toml::Value::Table(inner) => inner.into_iter().collect::<Vec<_>>(),
        value => vec![(key, value)],
    });
    entries.collect()
}
