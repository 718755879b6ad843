//! Multilayer perceptrons as signed distance fields, and radiance heads on their surfaces.
//!
//! A [`Network`] maps a point of world space to a signed distance: negative inside, positive
//! outside, in world units. It implements [`field::Field`]: value, exact spatial gradient,
//! Hessian–vector products and the parameter gradient of α f + c·∇f, each by a hand-written sweep
//! over blocks of points; there is no tape. A [`RadianceHead`] maps a surface point, its unit
//! normal and the view direction to linear RGB.
//!
//! ```
//! use field::Field;
//! use glam::DVec3;
//! use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};
//!
//! let architecture = Architecture {
//!     encoding: Encoding::Frequency { bands: 4 },
//!     hidden: vec![64; 3],
//!     skip: vec![],
//!     activation: Activation::Softplus { beta: 100.0 },
//! };
//! // A network that starts as a sphere of half the radius of its ball.
//! let network = Network::<f64>::geometric(architecture, Transform::default(), 0.5, 7);
//! let (mut f, mut gradient) = ([0.0], [DVec3::ZERO]);
//! network.value_gradient(&[DVec3::new(0.8, 0.0, 0.0)], &mut f, &mut gradient);
//! assert!((f[0] - 0.3).abs() < 0.05 && (gradient[0].length() - 1.0).abs() < 0.2);
//!
//! // A model file round trip.
//! let again = Network::<f64>::from_safetensors(&network.to_safetensors()?)?;
//! assert_eq!(again.parameters(), network.parameters());
//! # Ok::<(), sdf_nn::ModelError>(())
//! ```
//!
//! # What it costs
//! In matrix work, a value pass is 1, a gradient 2, a Hessian–vector product 4, a parameter
//! gradient 6. Kernels run blocks of 32 points through all layers, with AVX-512 or AVX2 and fused
//! multiply–adds where the machine has them (single precision; both give the same bits). A point's
//! result does not depend on the batch it is in. Fields do not parallelise; callers split batches.
//!
//! # What it does not promise
//! A network is not a distance: |∇f| strays from 1 wherever training did not hold it. Bits differ
//! between machines with and without fused multiply–add.

#![allow(
    clippy::needless_range_loop,
    reason = "lanes and rows of several arrays go in step: an index says so"
)]

mod architecture;

mod encode;
mod head;
mod init;
mod kernel;
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
