//! The summary of a fit before its first iteration.

use ::inspect::Report;
use dataset::Dataset;
use fit::{BackgroundKind, MaskUse, RunFile};

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
    global.say(&format!("views: {train} to fit, {test} held out, {width} x {height} pixels"));
    global.say(&format!("sphere: centre ({x:.4}, {y:.4}, {z:.4}), radius {radius:.4}, {source}"));
    modelled(&report, file).iter().for_each(|line| global.say(line));
    global.say(&format!("exposure: {}", report.exposure_text()));
    report.warnings.iter().for_each(|warning| global.say(&format!("WARNING {warning}")));
}

/// The model for the background with its reason, and the use of masks.
fn modelled(report: &Report, file: &RunFile) -> [String; 2] {
    let model = match file.background_kind {
        _ if file.masks == MaskUse::Coverage => "none: the masks cut the object out",
        BackgroundKind::Constant => "one colour",
        BackgroundKind::PerView => "one colour for each photograph",
        BackgroundKind::Direction => "an environment by direction, trained",
        BackgroundKind::Volume => "a volume behind the bounding sphere, trained",
    };
    let confidence = file.background_confidence;
    let reason = match file.masks {
        MaskUse::Coverage => String::new(),
        _ => format!(" (confidence in uniform photographs: {confidence:.2} of 1)"),
    };
    let masks = match (report.masks, file.masks) {
        (0, _) => "none".to_owned(),
        (n, MaskUse::Coverage) => format!("of {n} views, used (see --masks)"),
        (n, MaskUse::LeaveOut) => format!("of {n} views, pixels left out (see --masks)"),
        (n, MaskUse::None) => format!("of {n} views, not used in the fit (see --masks)"),
    };
    [format!("background: {model}{reason}"), format!("masks: {masks}")]
}
