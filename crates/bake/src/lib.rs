#![doc = include_str!("../README.md")]

mod bake;
mod paint;
mod texels;
mod unwrap;

pub use bake::{Baked, GREY, bake};
pub use paint::paint;
pub use unwrap::{UnwrapError, Unwrapped, unwrap};
