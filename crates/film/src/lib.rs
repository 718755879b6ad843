#![doc = include_str!("../README.md")]

mod film;
mod label;
mod sheet;
mod srgb;

pub use film::Film;
pub use label::labelled;
pub use sheet::contact_sheet;
pub use srgb::{srgb_decode, srgb_encode};
