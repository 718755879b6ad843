#![doc = include_str!("../README.md")]
#![allow(
    clippy::needless_range_loop,
    reason = "kernels index several arrays by the same lane or row"
)]

mod architecture;
mod encode;
mod head;
mod init;
mod math;
mod mlp;
mod model_file;
mod network;
mod simd;

pub use architecture::{Activation, Architecture, Encoding, Transform};
pub use head::RadianceHead;
pub use math::Lane;
pub use model_file::ModelError;
pub use network::Network;
