//! The name of random decisions that several files share.

use random::Name;

/// The steps with refined cameras: parts 0 to 2 are those of a trial, and 3 and 4 those of an
/// alignment.
pub(crate) const CAMERA_TRIAL: Name = Name::new("steps with refined cameras", 28);
