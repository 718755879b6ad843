//! The verdict on a run, and the choices of a fit in words.

use clap::ValueEnum;
use dataset::Dataset;
use fit::{Model, RunFile, Solid};
use loss::photometry::{BackgroundChoice, BackgroundKind, ExposureModel, MaskChoice, MaskUse};
use render::{Camera, InvalidField};

use crate::verdict::{Evidence, Verdict};

/// The verdict on a run. The data set is relative to the run's origin, and has the cameras and the
/// exposures as fitted.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn examine(model: &Model, file: &RunFile, dataset: &Dataset) -> Result<Verdict, InvalidField> {
    let views = || dataset.train.iter().chain(&dataset.test);
    let cameras: Vec<Camera> = views().map(|view| view.camera).collect();
    let solid = Solid::new(model, file);
    let colors = file.background_of(views());
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let is_uniform = match file.background_kind {
        BackgroundKind::Constant | BackgroundKind::PerView => true,
        BackgroundKind::Picture | BackgroundKind::Direction | BackgroundKind::Volume => false,
    };
    let background = file.background();
    let (sphere, fits_exposures) = (file.sphere(), file.exposure_model == ExposureModel::PerView);
    let evidence =
        Evidence::collect(&scene, &sphere, dataset, &background, is_uniform, fits_exposures)?;
    Ok(Verdict::of(evidence))
}

/// The model for the background with its reason, and the use of masks.
pub fn modelled(dataset: &Dataset, file: &RunFile) -> [String; 2] {
    let model = match file.background_kind {
        _ if file.masks == MaskUse::Coverage => "none: the masks cut the object out",
        BackgroundKind::Constant => "one colour",
        BackgroundKind::PerView => "one colour for each photograph",
        BackgroundKind::Picture => {
            "a picture that stands still in the image: an object turned in front of a fixed camera"
        }
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
        _ => format!(" (confidence that one colour explains it: {confidence:.2} of 1)"),
    };
    let views = || dataset.train.iter().chain(&dataset.test);
    let covered = views().filter(|view| view.coverage().is_some()).count();
    let others = views().filter(|view| view.mask.is_some()).count() - covered;
    let masks = match file.masks {
        MaskUse::Coverage => format!("of the object in {covered} views, used (see --masks)"),
        MaskUse::LeaveOut => format!("pixels are left out in {others} views (see --masks)"),
        MaskUse::None if covered > 0 => {
            let reason = match file.options.masks {
                MaskChoice::Ignore => "as asked",
                _ if covered < dataset.train.len() + dataset.test.len() => "some views have none",
                _ if file.background_kind == BackgroundKind::Picture => "a picture is behind it",
                _ if !file.background_kind.is_trained() => "the background is uniform",
                _ => "most are black or white everywhere, or the background was chosen",
            };
            format!("of the object in {covered} views, not used in the fit: {reason} (see --masks)")
        }
        MaskUse::None => "none used".to_owned(),
    };
    [format!("background: {model}{reason}"), format!("masks: {masks}")]
}
