//! The summary of a fit before its first iteration.

use dataset::Dataset;
use fit::{ExposureModel, RunFile};
use report::modelled;

use super::expected::expected;
use crate::cli::common::Global;

/// Prints a summary of the photographs, and one line for each warning that `dsdf inspect` gives.
/// The data set is relative to the run's origin; `source` is the origin of its bounding sphere.
pub(super) fn print(dataset: &Dataset, file: &RunFile, source: &str, global: &Global) {
    if global.quiet {
        return;
    }
    let report = ::inspect::inspect(dataset, &file.sphere(), &file.background(), source);
    let [x, y, z, radius] = file.bounds;
    let [width, height] = report.image_size;
    let (train, test) = (report.train_views, report.test_views);
    let held_out = match test {
        0 => "none held out (see --held-out)".to_owned(),
        some => format!("{some} held out"),
    };
    global.say(&format!("views: {train} to fit, {held_out}, {width} x {height} pixels"));
    let center = files::point([x, y, z], radius);
    let length = files::length(radius, radius);
    global.say(&format!("sphere: centre {center}, radius {length}, {source}"));
    modelled(dataset, file).iter().for_each(|line| global.say(line));
    let exposures = match file.exposure_model {
        ExposureModel::Even => "taken as equal",
        ExposureModel::PerView => "one for each photograph and channel, fitted",
    };
    global.say(&format!("exposure: {}; {exposures} (see --exposure)", report.exposure_text()));
    let trained = file.background_kind.is_trained();
    expected(&file.options, trained, rayon::current_num_threads())
        .iter()
        .for_each(|line| global.say(line));
    report.warnings.iter().for_each(|warning| global.say(&format!("WARNING {warning}")));
}
