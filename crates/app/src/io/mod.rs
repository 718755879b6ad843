//! Images, arrays and files that are replaced whole.

mod atomic;
mod images;
mod npy;

pub use atomic::atomic_write;
pub use images::{image_size, read_image, write_image};
pub use npy::{read_npy, write_npy};
