//! The application layer of dsdf.
pub mod camera;
pub mod data;
pub mod error;
pub mod film;
