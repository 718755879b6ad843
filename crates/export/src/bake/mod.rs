//! Colours of surface points and textures: the mean radiance towards the cameras that see them.

mod bake;
mod paint;
mod texels;
mod unwrap;

pub use bake::{Baked, GREY, bake};
pub use paint::paint;
pub use unwrap::{UnwrapError, Unwrapped, unwrap};
