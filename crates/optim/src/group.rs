//! The settings of a range of parameters.

use std::ops::Range;

use num_traits::Float;

/// A range of parameters with their own settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The name in error messages.
    pub name: String,
    /// The indices of its parameters.
    pub range: Range<usize>,
    /// The factor on the learning rate.
    pub rate: f64,
    /// β₁: the decay of the running mean of the gradient per step, in [0, 1).
    pub beta1: f64,
    /// β₂: the decay of the running mean of the squared gradient per step, in [0, 1).
    pub beta2: f64,
    /// Decoupled weight decay: a step also subtracts this times the learning rate times the
    /// parameter.
    pub weight_decay: f64,
    /// The least denominator of a step, in units of the root mean square gradient of the group.
    ///
    /// Without it, a parameter whose gradients are small makes steps as large as the others. That
    /// is wrong for coefficients that hardly matter, for example inside a solid.
    pub floor: f64,
    /// The number of columns, if the group is a matrix that takes the steps of Muon, row-major. It
    /// then has neither β₂ nor a floor.
    pub columns: Option<usize>,
}

impl Group {
    /// A group with the settings that Kingma and Ba suggest, β₁ = 0.9 and β₂ = 0.999, with rate 1,
    /// and without weight decay or floor.
    pub fn new(name: impl Into<String>, range: Range<usize>) -> Self {
        let (rate, beta1, beta2, weight_decay, floor) = (1.0, 0.9, 0.999, 0.0, 0.0);
        Group { name: name.into(), range, rate, beta1, beta2, weight_decay, floor, columns: None }
    }

    /// A matrix with this number of columns, row-major, that takes the steps of Muon (Jordan et al.,
    /// "Muon: An optimizer for hidden layers in neural networks", 2024): along the orthogonal matrix
    /// U Vᵀ of the singular value decomposition U Σ Vᵀ of a mean gradient with β₁ = 0.95, so that
    /// directions with small gradients take part.
    ///
    /// The root mean square of a step is about 0.2 learning rates, as with Adam (Liu et al., "Muon is
    /// Scalable for LLM Training", 2025). It suits the weights of hidden layers.
    pub fn matrix(name: impl Into<String>, range: Range<usize>, columns: usize) -> Self {
        Group { beta1: 0.95, columns: Some(columns), ..Self::new(name, range) }
    }
}

/// A number in the precision of the parameters.
pub(crate) fn constant<R: Float>(value: f64) -> R {
    R::from(value).unwrap_or_else(R::nan)
}
