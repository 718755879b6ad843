//! Cameras and shaders of signed distance fields.

mod camera;
mod shader;

pub use camera::Camera;
pub use shader::{Analytic, Formula, Light, MAX_LIGHTS, Precision, Shader, Shadowed};
