//! Running the `dsdf` program, and reading its results.

mod cargo;
pub mod dsdf;
pub mod host;
pub mod plot;
pub mod reference;

pub use cargo::{cargo, cargo_command};
