#![doc = include_str!("../README.md")]

mod background;
mod camera;
mod image;
mod invalid;
mod primary;
mod sample;
mod scene;
mod shader;
mod slope;

pub use background::{
    Background, BackgroundPerCamera, BackgroundRay, RayAdjoint, UniformBackground,
};
pub use camera::{Camera, CameraAdjoint};
pub use image::{Render, render};
pub use invalid::InvalidField;
pub use primary::{Hit, Primary, Surface, TracedRay, TracedSample, normals, retain_flagged};
pub use sample::{Pixel, Sample, pixel_samples};
pub use scene::{Scene, Tracing};
pub use shader::{Analytic, Formula, Light, MAX_LIGHTS, Precision, Shader, Shadowed};
