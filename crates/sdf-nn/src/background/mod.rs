//! A volume behind the bounding sphere, or an environment by direction, as a background.

mod decoder;
mod file;
mod grid;
mod path;
mod quadrature;
mod smooth;
mod volume;

pub use file::FileError;
pub use quadrature::Quadrature;
pub use volume::{Extent, INITIAL_VOLUME, Volume};

#[cfg(test)]
mod tests;
