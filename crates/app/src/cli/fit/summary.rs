//! The summary of a fit before its first iteration.

use ::inspect::Report;
use dataset::Dataset;
use fit::{BackgroundKind, RunFile};

use crate::cli::common::Global;
use crate::cli::examine::BoundsFrom;

/// Prints a summary of the photographs, and one line for each warning that `dsdf inspect` gives.
/// The data set is relative to the run's origin.
pub(super) fn print(dataset: &Dataset, file: &RunFile, bounds_from: BoundsFrom, global: &Global) {
    if global.quiet {
        return;
    }
    let source = bounds_from.text();
    let report = ::inspect::inspect(dataset, &file.sphere(), &file.background(), source);
    let [x, y, z, radius] = file.bounds;
    let [width, height] = report.image_size;
    let (train, test) = (report.train_views, report.test_views);
    global.say(&format!("views: {train} to fit, {test} held out, {width} x {height} pixels"));
    global.say(&format!("sphere: centre ({x:.4}, {y:.4}, {z:.4}), radius {radius:.4}, {source}"));
    modelled(&report, file).iter().for_each(|line| global.say(line));
    global.say(&format!("exposure: {}", report.exposure_text()));
    report.warnings.iter().for_each(|warning| global.say(&format!("WARNING {warning}")));
}

/// The model for the background with its reason, and the use of masks.
fn modelled(report: &Report, file: &RunFile) -> [String; 2] {
    let model = match file.background_kind {
        BackgroundKind::Constant => "one colour",
        BackgroundKind::Direction => "an environment by direction, trained",
        BackgroundKind::Volume => "a volume behind the bounding sphere, trained",
    };
    let confidence = file.background_confidence;
    let masks = match (report.masks, file.options.use_masks) {
        (0, _) => "none".to_owned(),
        (n, true) => format!("of {n} views, used"),
        (n, false) => format!("of {n} views, not used in the fit (see --use-masks)"),
    };
    [
        format!("background: {model} (confidence in one colour: {confidence:.2} of 1)"),
        format!("masks: {masks}"),
    ]
}
