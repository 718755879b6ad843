//! What a program that extends this one brings.

use std::any::Any;

use field::Real;
use warp::Weighting;

/// Weights of one's own for `--estimator custom`, in both precisions.
#[derive(Clone, Copy)]
pub struct Weights {
    single: &'static dyn Weighting<f32>,
    double: &'static dyn Weighting<f64>,
}

impl Weights {
    /// The weights that a type is.
    pub fn of<W: Weighting<f32> + Weighting<f64>>(weights: &'static W) -> Self {
        Weights { single: weights, double: weights }
    }

    /// Those of a precision.
    pub(crate) fn get<R: Real>(&self) -> Option<&'static dyn Weighting<R>> {
        let both: [&dyn Any; 2] = [&self.single, &self.double];
        both.into_iter().find_map(|one| one.downcast_ref::<&'static dyn Weighting<R>>().copied())
    }
}

impl std::fmt::Debug for Weights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Weights")
    }
}
