#![doc = include_str!("../README.md")]

mod name;
mod sobol;
mod stream;

pub use name::Name;
pub use sobol::SobolPoints;
pub use stream::{Stream, gaussian};
