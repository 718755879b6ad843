//! Colours of surface points and textures: the mean radiance towards the cameras that see them.

mod colours;
mod paint;
mod seen_only;
mod texels;
mod unwrap;

pub use colours::{Baked, GREY, bake};
pub use paint::paint;
pub use seen_only::SeenOnly;
pub use unwrap::{UnwrapError, Unwrapped, unwrap};
