#![doc = include_str!("../README.md")]

mod bytes;
mod components;
mod decimate;
mod edges;
mod export;
#[cfg(test)]
mod export_tests;
mod extract;
#[cfg(test)]
mod extract_tests;
#[cfg(test)]
mod file_tests;
mod glb;
mod glb_read;
mod grid;
mod manifold;
mod mesh;
mod obj;
mod ply;
mod points;
mod project;
mod read;
mod separate;
mod solid;
mod stl;
mod texture;
mod topology;
mod usdz;
mod write;

pub use components::{Components, keep_components, select_faces};
pub use decimate::decimate;
pub use export::Export;
pub use extract::{extract, extract_with};
pub use mesh::Mesh;
pub use obj::check_textured_obj;
pub use points::read_points;
pub use read::read_mesh;
pub use texture::Texture;
pub use write::{check_stl, export_mesh, write_mesh};
