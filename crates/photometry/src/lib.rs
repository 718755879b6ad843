#![doc = include_str!("../README.md")]

mod background;
mod loss;
mod mask_use;
mod pyramid;

pub use background::BackgroundModel;
pub use loss::{Target, photometric, squared_error};
pub use mask_use::MaskUse;
pub use pyramid::{Level, Photograph, Pixel, pyramid};
