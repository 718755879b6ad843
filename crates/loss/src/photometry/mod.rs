//! Photographs as the target of a fit: pyramid, masks, gains, and the loss of a pixel.

mod background;
mod background_choice;
mod downscale;
mod exposure_choice;
mod gains;
mod loss;
mod margin;
mod masks;
mod overexposed;
mod photograph;
mod pyramid;

pub use background::BackgroundModel;
pub use background_choice::{BackgroundChoice, BackgroundKind};
pub use downscale::{Limit, MEMORY_PER_PIXEL, downscale};
pub use exposure_choice::{ExposureChoice, ExposureModel};
pub use gains::{Gains, GainsError, gain_between, without_gains};
pub use loss::{Target, photometric, squared_error};
pub use masks::{MaskChoice, MaskUse, check_masks, put_over_black};
pub use photograph::{Draw, Photograph};
pub use pyramid::{Level, pyramid};
