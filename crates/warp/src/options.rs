//! Settings of the warp.

use field::Real;

/// Settings of the weights; METHOD's symbols. The published ones are γ = 3 and k between 2 and all
/// of N = 22.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options<R> {
    /// k: the points that are weighed, 2 or more; the smallest of them is what the others are
    /// shifted by, so k − 1 keep a weight. A ray of fewer than k points keeps all, unshifted: k
    /// above N turns the selection off. 3 is the least that gives a continuous V (see the crate's
    /// page).
    pub k: usize,
    /// γ: the exponent. Above 2 the weights tend to a delta at a silhouette.
    pub gamma: R,
    /// λ_d: the weight of |∇f·d| beside |f|, in world units.
    pub lambda_d: R,
    /// ε: added to S, in world units.
    pub epsilon: R,
    /// ρ: the fraction of f that a step of the recursion took.
    pub relaxation: R,
}

impl<R: Real> Default for Options<R> {
    fn default() -> Self {
        Options {
            k: 14,
            gamma: R::of(3.0),
            lambda_d: R::one(),
            epsilon: R::of(1e-6),
            relaxation: R::one(),
        }
    }
}

/// A setting that leaves no warp.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {found}, expected {expected}")]
pub struct InvalidOptions {
    /// The setting.
    pub name: &'static str,
    /// Its value.
    pub found: String,
    /// What it should be.
    pub expected: &'static str,
}

impl<R: Real> Options<R> {
    /// Checks every setting.
    ///
    /// # Errors
    /// On the first that cannot work.
    pub fn validate(&self) -> Result<(), InvalidOptions> {
        let zero = R::zero();
        let finite = |v: R| v.is_finite();
        let checks = [
            (
                "top_k",
                self.k.to_string(),
                self.k >= 2,
                "2 or more: the shift by the smallest weight leaves one point none",
            ),
            (
                "gamma",
                self.gamma.to_string(),
                self.gamma > zero && finite(self.gamma),
                "a number above 0",
            ),
            (
                "lambda_d",
                self.lambda_d.to_string(),
                self.lambda_d >= zero && finite(self.lambda_d),
                "0 or more",
            ),
            (
                "epsilon",
                self.epsilon.to_string(),
                self.epsilon >= zero && finite(self.epsilon),
                "0 or more",
            ),
            (
                "relaxation",
                self.relaxation.to_string(),
                self.relaxation > zero && finite(self.relaxation),
                "a number above 0",
            ),
        ];
        match checks.into_iter().find(|(_, _, holds, _)| !holds) {
            Some((name, found, _, expected)) => Err(InvalidOptions { name, found, expected }),
            None => Ok(()),
        }
    }
}
