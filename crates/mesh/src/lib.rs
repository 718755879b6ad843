#![doc = include_str!("../README.md")]

mod bytes;
mod components;
mod edges;
mod extract;
#[cfg(test)]
mod extract_tests;
#[cfg(test)]
mod file_tests;
mod glb;
mod grid;
mod manifold;
mod mesh;
mod project;
mod read;
mod separate;
mod solid;
mod write;

pub use components::Components;
pub use extract::{extract, extract_with};
pub use mesh::Mesh;
pub use read::read_mesh;
pub use write::write_mesh;

use std::path::Path;

/// The extension of a path in lower case, empty if there is none.
fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}
