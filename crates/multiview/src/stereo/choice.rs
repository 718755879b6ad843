//! The choice of a guide by depths.

use serde::{Deserialize, Serialize};

/// The choice of a guide by depths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum StereoChoice {
    /// In front of a trained background
    #[default]
    Auto,
    /// None
    None,
    /// In front of any background
    Use,
}

impl StereoChoice {
    /// Whether depths are used, for a background that is trained or not.
    pub fn is_used(self, is_trained: bool) -> bool {
        match self {
            StereoChoice::Auto => is_trained,
            StereoChoice::None => false,
            StereoChoice::Use => true,
        }
    }
}
