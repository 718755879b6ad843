#![doc = include_str!("../README.md")]

mod load;
mod masks;
pub mod readers;
mod split;
#[cfg(test)]
mod tests;
mod view;
mod write;

pub use crate::readers::{ALL_USED, Distortion, Mask, MaskKind, View};
pub use load::{LoadOptions, Unread, load, open, open_with};
pub use split::{HELD_OUT, HeldOut};
pub use view::Dataset;
pub use write::{check_empty, write};
