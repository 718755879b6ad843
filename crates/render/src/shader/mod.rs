//! Shaders: the radiance at surface points, and its derivatives.

mod analytic;
mod shaded;
mod shadowed;

pub use analytic::{Analytic, Formula, Light, MAX_LIGHTS};
pub use shaded::{Precision, Shader};
pub use shadowed::Shadowed;
