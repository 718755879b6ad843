//! Images, arrays and files that are replaced whole.

mod atomic;
mod error;
mod images;
pub mod json;
mod npy;

pub use atomic::atomic_write;
pub use error::InputError;
pub use images::{image_size, read_image, write_image};
pub use npy::{read_npy, write_npy};
