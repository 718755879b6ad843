#![doc = include_str!("../README.md")]

mod counted;
mod csg;
mod dual;
#[allow(clippy::module_inception, reason = "the trait that the crate is named for")]
mod field;
mod real;
mod shape;
mod sphere;
mod surface;

pub use counted::{Counted, Evaluations};
pub use csg::{Csg, Operation};
pub use dual::{Dual, Scalar};
pub use field::Field;
pub use real::{Real, Vector3};
pub use shape::{Kind, Shape};
pub use sphere::Sphere;
pub use surface::{SurfaceAdjoint, SurfaceBatch};
