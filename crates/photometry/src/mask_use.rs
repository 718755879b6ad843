//! The use of masks.

use serde::{Deserialize, Serialize};

/// The use of the masks of a data set in a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MaskUse {
    /// No use.
    None,
    /// The coverage of the object: it is composited over a colour that changes from iteration to
    /// iteration, and the model is rendered in front of the same colour.
    Coverage,
    /// Pixels are left out.
    LeaveOut,
}
