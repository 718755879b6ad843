#![doc = include_str!("../README.md")]

mod atomic;
mod error;
mod image_read;
#[cfg(test)]
mod image_tests;
mod image_write;
pub mod json;
mod npy;

pub use atomic::atomic_write;
pub use error::InputError;
pub use image_read::{image_size, read_image};
pub use image_write::write_image;
pub use npy::{read_npy, write_npy};

use std::path::Path;

/// The extension of a path in lower case, empty if there is none.
fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}
