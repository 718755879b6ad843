#![doc = include_str!("../README.md")]

mod decoder;
mod file;
mod grid;
mod path;
mod volume;

pub use file::FileError;
pub use volume::{Extent, Volume};

#[cfg(test)]
mod tests;
