#![doc = include_str!("../README.md")]

mod atomic;
mod bounds;
mod check;
mod duration;
mod error;
mod exif;
mod heif;
mod image_read;
#[cfg(test)]
mod image_tests;
mod image_write;
pub mod json;
mod lock;
mod memory;
mod npy;
#[cfg(test)]
mod photo_tests;
mod regular;
pub mod run_json;
pub mod seconds;

pub use atomic::{
    atomic_write, check_output, check_output_folder, remove_abandoned_temporary_files,
    remove_own_temporary_files,
};
pub use bounds::{SPHERE, is_sphere, parse_bounds};
pub use check::Check;
pub use duration::parse_duration;
pub use error::{ARGUMENTS, InputError, is_hidden, printable};
pub use exif::FocalLength;
pub use heif::refuse_unconverted;
pub use image_read::{
    TurnedByExif, check_image, focal_length, image_size, read_image, read_image_of, reading_memory,
    turned_by_exif,
};
pub use image_write::{png, write_image};
pub use lock::lock;
pub use memory::{check_memory, memory_limit};
pub use npy::{NpyReader, npy_reader, read_npy, write_npy};
pub use regular::{open, read, read_text};

use std::path::Path;

/// The extension of a path in lower case, empty if there is none.
pub fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}
