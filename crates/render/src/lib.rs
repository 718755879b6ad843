#![doc = include_str!("../README.md")]

mod camera;
mod direction;
mod image;
mod invalid;
mod lattice;
mod preview;
mod primary;
mod sample;
mod scene;
mod shader;
mod slope;
mod turntable;

pub use camera::{Camera, CameraAdjoint};
pub use direction::{named, snapped};
pub use image::{Render, render};
pub use invalid::InvalidField;
pub use preview::{comparison, difference};
pub use primary::{Hit, Primary, Surface, TracedRay, TracedSample, normals, retain_flagged};
pub use sample::{Pixel, Sample, pixel_samples};
pub use scene::{Scene, Tracing};
pub use shader::{Analytic, Formula, Light, MAX_LIGHTS, Shadowed};
pub use turntable::{around, turntable, upwards};
