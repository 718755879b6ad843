//! Calibrations of the cameras of a fit.

use dataset::View;
use field::Sphere;
use multiview::calibrate::{Calibration, Freedom, RefineCameras};
use render::Camera;

/// The calibration of the cameras of these views.
pub(crate) fn calibration(views: &[View], sphere: Sphere<f64>, freedom: Freedom) -> Calibration {
    Calibration::new(views.iter().map(|view| view.camera).collect(), sphere, freedom)
}

/// The cameras of all views at the size of `bases`.
pub(crate) fn corrected(calibration: Option<&Calibration>, bases: &[Camera]) -> Vec<Camera> {
    match calibration {
        Some(c) => bases.iter().enumerate().map(|(view, base)| c.apply(view, base)).collect(),
        None => bases.to_vec(),
    }
}

/// The parameters of cameras that keypoint matches can adjust. Matches fix focal lengths well,
/// unlike the photometric loss. `None` if distortion is refined: the search for depths has no
/// distortion.
pub(crate) fn freedom_by_matches(choice: RefineCameras) -> Option<Freedom> {
    let freedom = choice.freedom().filter(|freedom| !freedom.lens)?;
    Some(Freedom { focal: freedom.focal || choice == RefineCameras::Auto, ..freedom })
}
