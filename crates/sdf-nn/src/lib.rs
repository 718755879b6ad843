#![doc = include_str!("../README.md")]
#![allow(
    clippy::needless_range_loop,
    reason = "kernels index several arrays by the same lane or row"
)]

mod architecture;
mod encode;
mod few_points;
mod grid;
mod head;
mod init;
mod mlp;
mod model_file;
mod network;
mod passes;

pub use grids::{Degree, SplineSize};
pub use lanes::{Instructions, Lane};

pub use architecture::{Activation, Architecture, Encoding, Transform};
pub use head::RadianceHead;
pub use model_file::ModelError;
pub use network::Network;
pub use passes::Passes;
