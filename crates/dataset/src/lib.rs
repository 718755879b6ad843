#![doc = include_str!("../README.md")]

mod backdrop;
mod background;
mod bounds;
mod carve;
mod cloud;
mod distant;
mod load;
mod masks;
mod split;
#[cfg(test)]
mod tests;
mod view;

pub use background::BackgroundEstimate;
pub use bounds::{
    SphereSource, Surroundings, check_cameras, check_places, looks_away, surroundings,
};
pub use load::{LoadOptions, Unread, load, open};
pub use readers::{ALL_USED, Distortion, Mask, MaskKind, View};
pub use split::HELD_OUT;
pub use view::Dataset;
