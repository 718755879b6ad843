//! The application layer of dsdf.
pub mod camera;
pub mod cli;
pub mod data;
pub mod error;
pub mod estimate;
pub mod film;
pub mod fit;
pub mod inspect;
pub mod io;
pub mod mesh;
pub mod metrics;
pub mod sampler;
pub mod scene;
pub mod synth;
