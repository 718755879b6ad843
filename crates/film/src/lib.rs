//! Images.

mod film;
mod sheet;

pub use film::{Film, srgb_decode, srgb_encode};
pub use sheet::contact_sheet;
