#![doc = include_str!("../README.md")]

mod background;
mod loss;
mod masks;
mod pyramid;

pub use background::BackgroundModel;
pub use loss::{Target, photometric, squared_error};
pub use masks::{MaskChoice, MaskUse, check_masks, put_over_black};
pub use pyramid::{Level, Photograph, Pixel, pyramid};
