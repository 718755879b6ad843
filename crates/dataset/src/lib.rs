#![doc = include_str!("../README.md")]

mod background;
mod bounds;
mod carve;
pub mod inspect;
mod lens;
mod load;
mod projection;
mod readers;
mod split;
#[cfg(test)]
mod tests;
mod unread;
mod view;

pub use background::Background;
pub use bounds::{check_cameras, looks_away, surroundings};
pub use load::{LoadOptions, Unread, load, open};
pub use split::HELD_OUT;
pub use view::{Dataset, View};
