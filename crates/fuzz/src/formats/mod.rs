//! The formats: valid files with random counts, shapes and types, to be harmed.

pub(crate) mod arrays;
pub(crate) mod datasets;
pub(crate) mod forms;
pub(crate) mod images;
pub(crate) mod meshes;
pub(crate) mod models;
pub(crate) mod runs;
pub(crate) mod scenes;
pub(crate) mod solids;
pub(crate) mod sweeps;
mod views;
