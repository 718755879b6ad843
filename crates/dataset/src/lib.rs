#![doc = include_str!("../README.md")]

mod background;
mod bounds;
mod carve;
mod lens;
mod load;
mod mask;
mod projection;
mod readers;
mod split;
#[cfg(test)]
mod tests;
mod unread;
mod view;

pub use background::BackgroundEstimate;
pub use bounds::{SphereSource, Surroundings, check_cameras, looks_away, surroundings};
pub use load::{LoadOptions, Unread, load, open};
pub use mask::{Mask, MaskKind};
pub use split::HELD_OUT;
pub use view::{Dataset, View};
