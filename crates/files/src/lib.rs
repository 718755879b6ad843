#![doc = include_str!("../README.md")]

mod atomic;
mod bounds;
mod duration;
mod error;
pub mod json;
mod length;
mod lock;
mod memory;
mod regular;
pub mod seconds;

pub use atomic::{
    atomic_write, atomic_write_private, check_output, check_output_folder,
    remove_abandoned_temporary_files, remove_own_temporary_files,
};
pub use bounds::{SPHERE, is_sphere, parse_bounds};
pub use duration::parse_duration;
pub use error::{ARGUMENTS, InputError, WriteError, is_hidden, printable};
pub use length::{length, point};
pub use lock::lock;
pub use memory::{check_memory, memory_limit};
pub use regular::{open, read, read_text};

use std::path::Path;

/// The extension of a path in lower case, empty if there is none.
pub fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}
