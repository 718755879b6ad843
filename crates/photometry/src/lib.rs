#![doc = include_str!("../README.md")]

mod background;
mod gains;
mod loss;
mod masks;
mod pyramid;

pub use background::BackgroundModel;
pub use gains::{Gains, GainsError, as_exposed, gain_between, without_gains};
pub use loss::{Target, photometric, squared_error};
pub use masks::{MaskChoice, MaskUse, check_masks, put_over_black};
pub use pyramid::{Level, Photograph, Pixel, pyramid};
