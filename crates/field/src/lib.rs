#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]

mod background;
mod check;
mod clipped;
mod counted;
mod csg;
mod dual;
mod fibonacci;
#[allow(clippy::module_inception, reason = "the trait that the crate is named for")]
mod field;
mod partial_sum;
mod real;
mod shader;
mod shape;
mod slope;
mod sphere;
mod surface;

pub use background::{
    Background, BackgroundPerCamera, BackgroundRay, FilmPlace, RayAdjoint, UniformBackground,
};
pub use check::{Check, InvalidSetting};
pub use clipped::{Clipped, may_reach};
pub use counted::{Counted, Evaluations};
pub use csg::{Csg, Operation};
pub use dual::{Dual, Scalar};
pub use fibonacci::fibonacci_direction;
pub use field::Field;
pub use partial_sum::{Additions, PartialSum, TableSum};
pub use real::{Real, Vector3};
pub use shader::{Precision, Shader};
pub use shape::{Kind, Shape};
pub use slope::{SLOPE_POINTS, slope, slope_of, slope_places};
pub use sphere::Sphere;
pub use surface::{SurfaceAdjoint, SurfaceBatch};
