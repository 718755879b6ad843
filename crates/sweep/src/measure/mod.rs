//! Runs the program `dsdf`, reads its JSON and its derivative images, and draws plots.

mod cargo;
pub mod dsdf;
pub mod host;
pub mod image;
pub mod npy;
pub mod plot;
pub mod reference;
pub mod suite;

pub use cargo::{cargo, cargo_command, workspace_root};
