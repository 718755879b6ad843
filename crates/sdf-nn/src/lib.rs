#![doc = include_str!("../README.md")]
#![allow(
    clippy::needless_range_loop,
    reason = "kernels index several arrays by the same lane or row"
)]

mod architecture;
pub mod background;
mod encode;
mod few_points;
pub mod grids;
mod head;
mod init;
mod mlp;
mod model_file;
mod network;
mod network_field;
mod network_passes;
mod passes;
mod pool;
mod shader;
mod spline_block;
pub mod tensor_file;

pub use crate::grids::{Degree, SplineSize};
pub use lanes::{Instructions, Lane};

pub use architecture::{Activation, Architecture, Encoding, Transform};
pub use head::RadianceHead;
pub use model_file::ModelError;
pub use network::Network;
#[doc(hidden)]
pub use passes::AnyPass;
pub use passes::Passes;
