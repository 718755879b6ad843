//! The refinement of cameras in a fit.

use calibrate::{Calibration, Freedom};
use dataset::View;
use field::Sphere;
use render::Camera;
use serde::{Deserialize, Serialize};

/// The cameras that a fit refines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum RefineCameras {
    /// The cameras stay as given
    None,
    /// Poses and focal lengths are refined if that explains the photographs better
    #[default]
    Auto,
    /// The rotation and the position of each view
    Poses,
    /// Poses, and the focal length of each lens
    Focal,
    /// Poses, focal lengths, principal points and radial distortion
    All,
}

impl RefineCameras {
    /// The parameters that are refined, if any are.
    pub(crate) fn freedom(self) -> Option<Freedom> {
        let all = Freedom { poses: true, focal: true, lens: true };
        match self {
            RefineCameras::None => None,
            RefineCameras::Auto | RefineCameras::Focal => Some(Freedom { lens: false, ..all }),
            RefineCameras::Poses => Some(Freedom::POSES),
            RefineCameras::All => Some(all),
        }
    }
}

/// The result of a trial: whether cameras explain the photographs better after refinement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraTrial {
    /// The mean robust residual of a pixel with the given cameras.
    pub given: f64,
    /// The same with the refined ones.
    pub refined: f64,
    /// The standard error of the difference, over the views.
    pub noise: f64,
    /// The median correction of a view, in pixels.
    pub pixels: f64,
    /// Whether the corrections are kept.
    pub is_kept: bool,
}

/// The residual must fall by this many standard errors.
const ERRORS: f64 = 3.0;

/// The residual must fall by this share of itself.
const LEAST_FALL: f64 = 0.02;

impl CameraTrial {
    /// The result, from the mean residuals of each view with the given and with the refined
    /// cameras.
    pub(crate) fn of(given: &[f64], refined: &[f64], calibration: &Calibration) -> Self {
        let n = given.len() as f64;
        let falls: Vec<f64> = given.iter().zip(refined).map(|(a, b)| a - b).collect();
        let [given, refined] = [given, refined].map(|all| all.iter().sum::<f64>() / n);
        let fall = given - refined;
        let variance = falls.iter().map(|f| (f - fall) * (f - fall)).sum::<f64>() / n;
        let noise = (variance / (n - 1.0).max(1.0)).sqrt();
        let mut pixels: Vec<f64> = calibration.corrections().iter().map(|c| c.pixels).collect();
        pixels.sort_by(f64::total_cmp);
        let is_kept = fall > ERRORS * noise && fall > LEAST_FALL * given;
        CameraTrial { given, refined, noise, pixels: pixels[pixels.len() / 2], is_kept }
    }

    /// The result in one line.
    pub fn text(&self) -> String {
        let fall = 100.0 * (1.0 - self.refined / self.given);
        let noise = 100.0 * self.noise / self.given;
        let verdict = if self.is_kept { "refined from here on" } else { "kept as given" };
        format!(
            "cameras: {verdict}; a trial lowers the residual by {fall:.1} % (noise {noise:.1} %) \
             and moves a view by {:.2} pixels",
            self.pixels
        )
    }
}

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
