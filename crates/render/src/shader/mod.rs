//! Shaders: the radiance at surface points, and its derivatives.

mod analytic;
mod shadowed;

pub use analytic::{Analytic, Formula, Light, MAX_LIGHTS};
pub use shadowed::Shadowed;
