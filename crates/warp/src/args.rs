//! The options of the warp as flags of a command and as a table of a file.

use std::marker::PhantomData;

use crate::options::WarpOptions;

/// The default options of a command, for its [`WarpArgs`].
pub trait WarpDefaults {
    /// An option that is not given has its value of these.
    const OPTIONS: WarpOptions;
}

/// [`WarpOptions`] with the defaults of a command: its flags (feature `clap`), and a table of a
/// file that it reads and writes (feature `serde`).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields, bound = "D: WarpDefaults"))]
pub struct WarpArgs<D: WarpDefaults> {
    // Not `default_value_t`: its text is a static of a generic function, so that the command that
    // is built first would set the defaults of all.
    /// N: points of the quadrature along a ray (only the warps use this and the next four options)
    #[cfg_attr(feature = "clap", arg(long, default_value = D::OPTIONS.steps.to_string()))]
    #[cfg_attr(feature = "clap", arg(hide_short_help = true))]
    pub steps: usize,
    /// k: points that are weighed; the smallest weight is subtracted, so k − 1 keep one
    #[cfg_attr(feature = "clap", arg(long, default_value = D::OPTIONS.top_k.to_string()))]
    #[cfg_attr(feature = "clap", arg(hide_short_help = true))]
    pub top_k: usize,
    /// γ: exponent of the weights
    #[cfg_attr(feature = "clap", arg(long, default_value = D::OPTIONS.gamma.to_string()))]
    #[cfg_attr(feature = "clap", arg(hide_short_help = true))]
    pub gamma: f64,
    /// λ_d: weight of |∇f·d| beside |f|, in bounding radii
    #[cfg_attr(feature = "clap", arg(long, default_value = D::OPTIONS.lambda_d.to_string()))]
    #[cfg_attr(feature = "clap", arg(hide_short_help = true))]
    pub lambda_d: f64,
    /// ε: length added to |f| + λ_d |∇f·d|, in bounding radii
    #[cfg_attr(feature = "clap", arg(long, default_value = D::OPTIONS.epsilon.to_string()))]
    #[cfg_attr(feature = "clap", arg(hide_short_help = true))]
    pub epsilon: f64,
    #[cfg_attr(feature = "clap", arg(skip))]
    #[cfg_attr(feature = "serde", serde(skip))]
    defaults: PhantomData<D>,
}

impl<D: WarpDefaults> Default for WarpArgs<D> {
    fn default() -> Self {
        D::OPTIONS.into()
    }
}

impl<D: WarpDefaults> From<WarpOptions> for WarpArgs<D> {
    fn from(options: WarpOptions) -> Self {
        let WarpOptions { steps, top_k, gamma, lambda_d, epsilon } = options;
        WarpArgs { steps, top_k, gamma, lambda_d, epsilon, defaults: PhantomData }
    }
}

impl<D: WarpDefaults> From<WarpArgs<D>> for WarpOptions {
    fn from(args: WarpArgs<D>) -> Self {
        let WarpArgs { steps, top_k, gamma, lambda_d, epsilon, .. } = args;
        WarpOptions { steps, top_k, gamma, lambda_d, epsilon }
    }
}
