//! The verdict on a run, which `dsdf fit` and `dsdf inspect` share.

use ::inspect::{Evidence, Verdict};
use dataset::Dataset;
use fit::{ExposureModel, Model, RunFile, Solid};
use render::Camera;

/// The verdict on a run. The data set is relative to the run's origin.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(super) fn examine(model: &Model, file: &RunFile, dataset: &Dataset) -> anyhow::Result<Verdict> {
    let views = || dataset.train.iter().chain(&dataset.test);
    let cameras: Vec<Camera> = views().map(|view| view.camera).collect();
    let solid = Solid::new(model, file);
    let colors = file.background_of(views());
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let (background, is_uniform) = (file.background(), !file.background_kind.is_trained());
    let (sphere, fits_exposures) = (file.sphere(), file.exposure_model == ExposureModel::PerView);
    let evidence =
        Evidence::collect(&scene, &sphere, dataset, &background, is_uniform, fits_exposures)?;
    Ok(Verdict::of(evidence))
}
