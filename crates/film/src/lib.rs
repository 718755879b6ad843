#![doc = include_str!("../README.md")]

mod blocks;
mod exif;
mod film;
mod formats;
mod heif;
mod image_read;
#[cfg(test)]
mod image_tests;
mod image_write;
mod label;
mod npy;
#[cfg(test)]
mod photo_tests;
mod resize;
mod sheet;
mod srgb;
mod stored;

pub use blocks::block_row;
pub use exif::FocalLength;
pub use film::Film;
pub use heif::refuse_unconverted;
pub use image_read::{
    TurnedByExif, check_image, focal_length, image_size, read_image, read_image_of,
    read_stored_image_of, reading_memory, turned_by_exif,
};
pub use image_write::{EncodeError, png, write_image};
pub use label::labelled;
pub use npy::{NpyReader, npy_reader, read_npy, write_npy};
pub use sheet::contact_sheet;
pub use srgb::{srgb_decode, srgb_encode};
pub use stored::StoredImage;
