//! The refinement of cameras in a fit.

use calibrate::{Calibration, Freedom};
use dataset::View;
use field::Sphere;
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
