//! Depth maps of photographs, and keypoint matches between them.

mod align;
mod carve;
mod check;
mod choice;
mod consistency;
mod depth;
mod guide;
mod patch;
mod photo;
mod search;
mod space;
mod tracks;

pub use align::HALF_PATCH;
pub use carve::pushes;
pub use choice::StereoChoice;
pub use consistency::{Consistency, PointConsistency};
pub use depth::{DepthMap, Stereo, View};
pub use guide::{Guide, GuidedRay, guide};
pub use patch::PATCH_REACH;
pub use tracks::Places;
