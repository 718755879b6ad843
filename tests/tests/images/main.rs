//! Derivative images and gradients of losses, by routes that share no code with the estimators.

#![allow(clippy::print_stdout, reason = "the measured errors")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

mod agreement;
mod cameras;
mod coverage;
mod extremes;
mod families;
mod far;
mod fields;
mod neural_target;
mod shader_parameters;
mod surface;
mod target_gradient;
mod truth;
