//! The start of a new run.

use std::path::Path;

use super::options::Fit;
use super::run_folder::absolute;
use crate::cli::common::{ARGUMENTS, Global};
use dataset::{Dataset, LoadOptions};
use fit::{FitOptions, Limit, MaskChoice, RunFile};
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
    let (dataset, downscale) = load_for(path, options, global)?;
    let dataset = match options.masks {
        MaskChoice::Ignore => dataset.with_all_pixels(),
        MaskChoice::Auto | MaskChoice::Use => dataset,
    };
    let options = FitOptions { downscale: Some(downscale), ..options.clone() };
    let (file, source) = RunFile::of_dataset(absolute(path), &dataset, &options)?;
    dataset::check_cameras(&dataset, &file.world_sphere())?;
    Ok((file.prepare(dataset), file, source.to_string()))
}

/// Loads a data set at the size at which a fit with these options reads it. Also returns the factor
/// by which width and height are reduced. A factor that is not an option is told on standard error.
///
/// # Errors
/// If the data set cannot be read.
pub(in crate::cli) fn load_for(
    path: &Path,
    options: &FitOptions,
    global: &Global,
) -> anyhow::Result<(Dataset, u32)> {
    let unread = dataset::open(path)?;
    let [train, held_out] = unread.sizes();
    let (downscale, limit) = options.downscale_for(&train, &held_out);
    if let Some(limit) = limit {
        global.say(&size_text(&train, downscale, limit));
    }
    let bar = global.progress("photographs");
    let dataset = unread.read(&LoadOptions { downscale }, &mut bar.mover())?;
    bar.finish_and_clear();
    Ok((dataset, downscale))
}

/// The size at which photographs of these sizes are read, and its reason, in one line.
fn size_text(whole: &[[u32; 2]], downscale: u32, limit: Limit) -> String {
    let sizes = || whole.iter().map(|size| size.map(|side| side.div_ceil(downscale)));
    let [width, height] =
        sizes().max_by_key(|[w, h]| u64::from(*w) * u64::from(*h)).unwrap_or([1; 2]);
    let up_to = if sizes().all(|size| size == [width, height]) { "" } else { "up to " };
    let reason = match limit {
        Limit::Budget => "as many pixels as the budget of a fit can use",
        Limit::Memory => "as many pixels as 4 GiB of memory can hold",
    };
    format!(
        "images: read at 1/{downscale} of their size ({up_to}{width} x {height} pixels), {reason}; \
         --downscale 1 reads them whole"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_has_size_reason_and_remedy() {
        let text = size_text(&[[4032, 3024]; 2], 3, Limit::Budget);
        let start = "images: read at 1/3 of their size (1344 x 1008 pixels), as many pixels as";
        assert!(
            text.starts_with(start) && text.ends_with("--downscale 1 reads them whole"),
            "{text}"
        );
        let text = size_text(&[[30, 41], [99, 10]], 4, Limit::Memory);
        assert!(text.contains("1/4 of their size (up to 8 x 11 pixels)"), "{text}");
        assert!(text.contains("4 GiB"), "{text}");
    }
}
