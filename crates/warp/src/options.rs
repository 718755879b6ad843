//! The settings of the published warp, as a user gives them.

use field::{Check, InvalidSetting, Real};

use crate::density::PublishedWeighting;

/// N, k, γ, λ_d and ε of the published warp (Bangaru et al. 2022, supplement, sections 1 and 3).
///
/// Lengths are in bounding radii, so that the same numbers mean the same for a scene of any size.
/// [`crate::WarpArgs`] has the same settings as flags of a command and as a table of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarpOptions {
    /// N: points of the quadrature along a ray.
    pub steps: usize,
    /// k: points that are weighed; the smallest weight is subtracted, so k − 1 keep one.
    pub top_k: usize,
    /// γ: exponent of the weights.
    pub gamma: f64,
    /// λ_d: weight of |∇f·d| beside |f|, in bounding radii.
    pub lambda_d: f64,
    /// ε: length added to |f| + λ_d |∇f·d|, in bounding radii.
    pub epsilon: f64,
}

/// The largest γ, λ_d and ε: single precision ends at 3e38, and weights beyond it vanish.
const MAX_VALUE: f64 = 1e30;

/// The largest N: as many samples as any other option accepts.
const MAX_STEPS: usize = 65_536;

impl WarpOptions {
    /// The defaults of derivative images: γ = 3 and N = 22 are published; k, λ_d and ε are not.
    ///
    /// - k = 14: k = 7 has 1.3 times its error and half of its time, k = 22 has 0.87 of its error
    ///   and 1.4 times its time (`cargo xtask record tradeoff`).
    /// - λ_d = 1: 0.1 has 0.6 of its error, and 10 has twice its error (`cargo xtask record tradeoff`).
    ///   The default stays, so that derivative images by old commands compare with new ones.
    /// - N = 22: over 150 fits N = 6 has 1.59 times the Chamfer distance of 22, N = 10 1.12 times,
    ///   N = 64 1.15 times and N = 200 1.22 times (`cargo xtask ablate steps-epsilon`).
    /// - γ = 3: γ = 1 has 3.0 times its Chamfer distance; 6 and 8 cannot be told apart from it
    ///   (`cargo xtask ablate k-gamma`).
    /// - ε = 1e-6: 0, 1e-8 and 1e-4 give the same Chamfer distance within 3 %, 1e-2 gives 1.22
    ///   times as much (`cargo xtask ablate steps-epsilon`).
    pub const IMAGE: WarpOptions =
        WarpOptions { steps: 22, top_k: 14, gamma: 3.0, lambda_d: 1.0, epsilon: 1e-6 };

    /// The defaults of fits.
    ///
    /// - λ_d = 0.02: with λ_d = 1 the gradient of a fit's loss was 25 % off its finite differences,
    ///   with 0.02 it is 9 % off; the Chamfer distance on `spot` after one minute fell from 2.0 to
    ///   0.7 %.
    /// - k = 7: k = 14 costs twice the second derivatives for a Chamfer distance 1.01 times as
    ///   large (0.89 to 1.16); k = 4 gives 1.19 times, k = 2 gives 1.16 times as much
    ///   (`cargo xtask ablate k-gamma`).
    pub const FIT: WarpOptions = WarpOptions { top_k: 7, lambda_d: 0.02, ..Self::IMAGE };

    /// Checks every setting.
    ///
    /// # Errors
    /// On the first setting that cannot work.
    pub fn validate(&self) -> Result<(), InvalidSetting> {
        const NOT_NEGATIVE: &str = "a finite number, 0 or more, up to 1e30";
        let finite_from =
            |value: f64, zero: bool| value <= MAX_VALUE && (value > 0.0 || (zero && value == 0.0));
        let length =
            |name, value: f64| Check::new(name, value, finite_from(value, true), NOT_NEGATIVE);
        Check::all([
            Check::new("steps", self.steps, (1..=MAX_STEPS).contains(&self.steps), "1 to 65536"),
            Check::new(
                "top_k",
                self.top_k,
                self.top_k >= 2,
                "2 or more: the smallest weight is subtracted, so one point alone keeps none",
            ),
            Check::new(
                "gamma",
                self.gamma,
                finite_from(self.gamma, false),
                "a finite number above 0, up to 1e30",
            ),
            length("lambda_d", self.lambda_d),
            length("epsilon", self.epsilon),
        ])
    }

    /// The weighting in world units, for a bounding sphere of `radius`.
    pub fn weighting<R: Real>(&self, radius: f64) -> PublishedWeighting<R> {
        PublishedWeighting {
            gamma: R::of(self.gamma),
            lambda_d: R::of(self.lambda_d * radius),
            epsilon: R::of(self.epsilon * radius),
        }
    }
}

impl Default for WarpOptions {
    fn default() -> Self {
        Self::IMAGE
    }
}
