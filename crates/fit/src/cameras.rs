//! The refinement of cameras in a fit.

use crate::checkpoint::{Optimised, Refinement};
use dataset::View;
use field::Sphere;
use multiview::calibrate::{Calibration, Freedom};
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

/// The corrections of a run's cameras, and where they come from.
#[derive(Debug)]
pub(crate) enum Corrections {
    /// It is not decided yet whether there are any.
    Undecided,
    /// None: the cameras stay as given.
    Given,
    /// The loss refines them.
    Refined(Calibration),
    /// Places of points gave them before the fit, and they stay.
    Adjusted(Calibration),
}

impl Corrections {
    /// The corrections; `None` if the cameras are those of the data set.
    pub(crate) fn calibration(&self) -> Option<&Calibration> {
        match self {
            Corrections::Refined(calibration) | Corrections::Adjusted(calibration) => {
                Some(calibration)
            }
            Corrections::Undecided | Corrections::Given => None,
        }
    }

    /// Those that places gave.
    pub(crate) fn adjusted(&self) -> Option<&Calibration> {
        if let Corrections::Adjusted(calibration) = self { Some(calibration) } else { None }
    }

    /// Those that the loss refines.
    pub(crate) fn refined_mut(&mut self) -> Option<&mut Calibration> {
        if let Corrections::Refined(calibration) = self { Some(calibration) } else { None }
    }

    /// Whether it is still open if cameras are corrected.
    pub(crate) fn is_undecided(&self) -> bool {
        matches!(self, Corrections::Undecided)
    }

    /// The state, for a checkpoint.
    pub(crate) fn state(&self) -> Refinement {
        let state = |calibration: &Calibration| Optimised::new(calibration.state());
        match self {
            Corrections::Undecided => Refinement::Undecided,
            Corrections::Given => Refinement::Given,
            Corrections::Refined(calibration) => Refinement::Refined(state(calibration)),
            Corrections::Adjusted(calibration) => Refinement::Adjusted(state(calibration)),
        }
    }
}
