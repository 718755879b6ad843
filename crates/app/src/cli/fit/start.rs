//! The start of a new run.

use std::path::Path;

use super::options::Fit;
use super::run_folder::absolute;
use crate::cli::common::{ARGUMENTS, Global};
use dataset::{Dataset, LoadOptions};
use fit::{FitOptions, RunFile};
use io::InputError;

impl Fit {
    /// The data set and the `fit.toml` of a new run, and the origin of its bounding sphere in
    /// words.
    pub(super) fn started_run(
        &self,
        global: &Global,
    ) -> anyhow::Result<(Dataset, RunFile, String)> {
        self.validate(global)?;
        let Some(path) = &self.dataset else {
            let expected = "a data set folder";
            return Err(InputError::new(ARGUMENTS, "DATASET", "nothing", expected).into());
        };
        new_run(path, &self.options)
    }
}

/// Loads a data set and determines the bounding sphere and the background of a run. The data set
/// is relative to the run's origin.
///
/// The bounding sphere is the one of the options or of the data set. Without these it is estimated
/// from cameras and background.
///
/// # Errors
/// If the data set cannot be read, or a camera does not suit the bounding sphere.
pub(in crate::cli) fn new_run(
    path: &Path,
    options: &FitOptions,
) -> anyhow::Result<(Dataset, RunFile, String)> {
    let dataset = dataset::load(path, &LoadOptions { downscale: options.downscale })?;
    let (file, source) = RunFile::of_dataset(absolute(path), &dataset, options)?;
    Ok((file.prepare(dataset), file, source.to_string()))
}
