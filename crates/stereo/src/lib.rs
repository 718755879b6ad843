#![doc = include_str!("../README.md")]

mod carve;
mod check;
mod choice;
mod depth;
mod guide;
mod patch;
mod photo;
mod search;

pub use carve::pushes;
pub use choice::StereoChoice;
pub use depth::{DepthMap, Stereo, View};
pub use guide::{Guide, GuidedRay, guide};
