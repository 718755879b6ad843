#![doc = include_str!("../README.md")]

mod blocks;
mod cut_short;
mod exif;
mod film;
mod foreign;
#[cfg(test)]
mod foreign_tests;
mod formats;
mod heif;
mod image_read;
#[cfg(test)]
mod image_tests;
mod image_write;
mod jpeg;
mod jpeg_scan;
mod jpeg_segments;
#[cfg(test)]
mod jpeg_tests;
mod label;
mod npy;
#[cfg(test)]
mod photo_tests;
mod profile;
#[cfg(test)]
mod profile_tests;
mod raw;
mod resize;
mod sheet;
mod srgb;
mod stored;
mod tiff_read;
#[cfg(test)]
mod tiff_tests;

pub use blocks::block_row;
pub use exif::FocalLength;
pub use film::Film;
pub use foreign::refuse_unconverted;
pub use formats::{IMAGE_EXTENSIONS, PHOTOGRAPH_EXTENSIONS, is_image_name, is_photograph_name};
pub use image_read::{
    TurnedByExif, check_image, focal_length, image_size, read_image, read_image_of,
    read_stored_image_of, reading_memory, turned_by_exif,
};
pub use image_write::{EncodeError, png, write_image};
pub use label::labelled;
pub use npy::{NpyReader, npy_numbers, npy_reader, read_npy, write_npy};
pub use profile::{ColorProfile, color_profile};
pub use sheet::contact_sheet;
pub use srgb::{srgb_decode, srgb_encode};
pub use stored::StoredImage;
