//! The choice of the cameras to refine, and the decision.

use serde::{Deserialize, Serialize};

use crate::calibrate::{Freedom, Matching, Trial};

/// The cameras that a fit refines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum RefineCameras {
    /// The cameras stay as given
    None,
    /// Poses, and focal lengths by keypoint matches, if that explains the photographs better
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
    pub fn freedom(self) -> Option<Freedom> {
        let all = Freedom { poses: true, focal: true, lens: true };
        match self {
            RefineCameras::None => None,
            RefineCameras::Auto | RefineCameras::Poses => Some(Freedom::POSES),
            RefineCameras::Focal => Some(Freedom { lens: false, ..all }),
            RefineCameras::All => Some(all),
        }
    }
}

/// The decision whether a fit refines its cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum CameraDecision {
    /// By keypoint matches, before the fit.
    Matching(Matching),
    /// By a trial.
    Trial(Trial),
    /// The cameras stay as given: the fit has too few iterations for a trial.
    TooShort {
        /// Iterations before the decision.
        iterations: u64,
        /// The least number of them.
        least: u64,
    },
}

impl CameraDecision {
    /// The decision in one line.
    pub fn text(&self) -> String {
        match self {
            CameraDecision::Matching(matching) => matching.text(),
            CameraDecision::Trial(trial) => trial.text(),
            CameraDecision::TooShort { iterations, least } => format!(
                "cameras: kept as given, without a trial: it needs {least} iterations before it, \
                 and the budget gives {iterations} (see --refine-cameras)"
            ),
        }
    }
}
