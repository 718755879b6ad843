#![doc = include_str!("../README.md")]

mod purpose;
mod stream;

pub use purpose::Purpose;
pub use stream::{Stream, gaussian};
