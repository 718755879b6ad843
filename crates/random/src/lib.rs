#![doc = include_str!("../README.md")]

mod purpose;
mod sobol;
mod stream;

pub use purpose::Purpose;
pub use sobol::SobolPoints;
pub use stream::{Stream, gaussian};
