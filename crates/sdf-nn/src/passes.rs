//! The passes of networks, compiled in this crate for both precisions.
//!
//! A generic function is compiled in every crate that calls it. The passes are large: they have a
//! version for each set of vector instructions. [`Passes::run`] is not generic where it is
//! implemented, so they are compiled once.

use std::fmt;

use field::Real;
use lanes::{Lane, dispatch};

use crate::head::{Radiance, Vjp};
use crate::network_passes::{HessianVector, ParameterVjp, Value, ValueGradient};

/// A precision of networks, `f32` or `f64`, with their passes.
///
/// [`Network`](crate::Network) and [`RadianceHead`](crate::RadianceHead) have the passes as
/// methods, and document them.
pub trait Passes: Lane {
    #[doc(hidden)]
    fn run(pass: AnyPass<'_, Self>);
}

impl Passes for f32 {
    fn run(pass: AnyPass<'_, f32>) {
        run(pass.0);
    }
}

impl Passes for f64 {
    fn run(pass: AnyPass<'_, f64>) {
        run(pass.0);
    }
}

/// A pass over a batch of points.
#[doc(hidden)]
pub struct AnyPass<'a, R: Real>(pub(crate) PassKind<'a, R>);

impl<R: Real> fmt::Debug for AnyPass<'_, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AnyPass").finish_non_exhaustive()
    }
}

/// The passes.
pub(crate) enum PassKind<'a, R: Real> {
    Value(Value<'a, R>),
    ValueGradient(ValueGradient<'a, R>),
    HessianVector(HessianVector<'a, R>),
    ParameterVjp(ParameterVjp<'a, R>),
    Radiance(Radiance<'a, R>),
    RadianceVjp(Vjp<'a, R>),
}

/// Runs a pass with the instructions of its perceptron.
fn run<R: Lane>(pass: PassKind<'_, R>) {
    match pass {
        PassKind::Value(pass) => dispatch(pass.network.mlp.instructions, pass),
        PassKind::ValueGradient(pass) => dispatch(pass.network.mlp.instructions, pass),
        PassKind::HessianVector(pass) => dispatch(pass.network.mlp.instructions, pass),
        PassKind::ParameterVjp(pass) => dispatch(pass.network.mlp.instructions, pass),
        PassKind::Radiance(pass) => dispatch(pass.head.mlp.instructions, pass),
        PassKind::RadianceVjp(pass) => dispatch(pass.head.mlp.instructions, pass),
    }
}
