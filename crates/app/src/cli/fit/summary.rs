//! The summary of a fit before its first iteration.

use clap::ValueEnum;
use dataset::Dataset;
use fit::{BackgroundChoice, BackgroundKind, ExposureModel, MaskUse, RunFile};

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
    modelled(dataset, file).iter().for_each(|line| global.say(line));
    let exposures = match file.exposure_model {
        ExposureModel::Even => "taken as equal",
        ExposureModel::PerView => "one for each photograph and channel, fitted",
    };
    global.say(&format!("exposure: {}; {exposures} (see --exposure)", report.exposure_text()));
    report.warnings.iter().for_each(|warning| global.say(&format!("WARNING {warning}")));
}

/// The model for the background with its reason, and the use of masks.
pub(in crate::cli) fn modelled(dataset: &Dataset, file: &RunFile) -> [String; 2] {
    let model = match file.background_kind {
        _ if file.masks == MaskUse::Coverage => "none: the masks cut the object out",
        BackgroundKind::Constant => "one colour",
        BackgroundKind::PerView => "one colour for each photograph",
        BackgroundKind::Direction => "an environment by direction, trained",
        BackgroundKind::Volume => "a volume behind the bounding sphere, trained",
    };
    let confidence = file.background_confidence;
    let asked = file.options.background;
    let reason = match file.masks {
        MaskUse::Coverage if asked != BackgroundChoice::Auto => {
            let asked = asked.to_possible_value();
            let name = asked.as_ref().map_or("", |value| value.get_name());
            format!("; --background {name} needs --masks ignore")
        }
        MaskUse::Coverage => String::new(),
        _ => format!(" (confidence in uniform photographs: {confidence:.2} of 1)"),
    };
    let views = || dataset.train.iter().chain(&dataset.test);
    let covered = views().filter(|view| view.coverage().is_some()).count();
    let others = views().filter(|view| view.mask.is_some()).count() - covered;
    let masks = match file.masks {
        MaskUse::Coverage => format!("of the object in {covered} views, used (see --masks)"),
        MaskUse::LeaveOut => format!("pixels are left out in {others} views (see --masks)"),
        MaskUse::None if covered > 0 => {
            format!("of the object in {covered} views, not used in the fit (see --masks)")
        }
        MaskUse::None => "none used".to_owned(),
    };
    [format!("background: {model}{reason}"), format!("masks: {masks}")]
}
