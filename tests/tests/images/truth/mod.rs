//! Derivative images by a route that shares neither tracer nor estimator with dsdf: closed-form
//! intervals of rays in solids, or dense samples of f along rays; films cut into rows; places where
//! the radiance jumps found by bisection; and central differences.

mod camera;
pub(crate) mod dense;
mod look;
mod rows;
mod solid;

pub(crate) use camera::Camera;
pub(crate) use look::Look;
pub(crate) use rows::truth;
pub(crate) use solid::Solid;
