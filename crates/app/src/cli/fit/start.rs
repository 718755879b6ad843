//! The start of a new run.

use std::path::Path;

use super::options::Fit;
use super::prepare_run::absolute;
use crate::cli::common::{ARGUMENTS, Global, with_flag};
use dataset::{Dataset, LoadOptions, Unread, open_with};
use files::InputError;
use fit::{FitOptions, MaskChoice, RunFile};

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
        new_run(path, &self.options, global)
    }
}

/// The data set and the `fit.toml` of a new run on the data set at `path`, and the origin of its
/// bounding sphere in words.
///
/// # Errors
/// If the data set cannot be read, by [`RunFile::of_dataset`], or if a camera does not suit the
/// bounding sphere.
pub(in crate::cli) fn new_run(
    path: &Path,
    options: &FitOptions,
    global: &Global,
) -> anyhow::Result<(Dataset, RunFile, String)> {
    let (dataset, downscale) = read_for(open_with(path, options.held_out)?, options, global)?;
    let dataset = match options.masks {
        MaskChoice::Ignore => dataset.with_all_pixels(),
        MaskChoice::Auto | MaskChoice::Use => dataset,
    };
    let options = FitOptions { downscale: Some(downscale), ..options.clone() };
    let (file, found) =
        RunFile::of_dataset(absolute(path), &dataset, &options).map_err(with_flag)?;
    inspect::check_cameras(&dataset, &file.world_sphere())?;
    Ok((file.prepare(dataset), file, found.source.to_string()))
}

/// Reads a data set at the size at which a fit with these options reads it. Also returns the factor
/// by which width and height are reduced. A factor that is not an option is told on standard error.
///
/// # Errors
/// If the data set cannot be read.
pub(in crate::cli) fn read_for(
    unread: Unread,
    options: &FitOptions,
    global: &Global,
) -> anyhow::Result<(Dataset, u32)> {
    let [train, held_out] = unread.sizes();
    let (downscale, limit) = options.downscale_for(&train, &held_out);
    if let Some(limit) = limit {
        global.say(&limit.text(&train, downscale));
    }
    let bar = global.progress("photographs");
    let dataset = unread.read(&LoadOptions { downscale }, &mut bar.mover())?;
    bar.finish_and_clear();
    Ok((dataset, downscale))
}
