//! The options of estimators.

use warp::WarpOptions;

/// The options of estimators. Each estimator uses those that apply to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatorOptions {
    /// The options of the published warp.
    pub warp: WarpOptions,
    /// The control variate of the published warp.
    pub baseline: Baseline,
}

impl Default for EstimatorOptions {
    fn default() -> Self {
        EstimatorOptions { warp: WarpOptions::IMAGE, baseline: Baseline::Background }
    }
}

/// The baseline c: a constant per pixel that is subtracted from the radiance in the terms of a
/// warp. It is a control variate.
///
/// Any constant gives the same expectation, since ∫∇·(c V) = ∮ c V·n over a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Baseline {
    /// The mean of the pixel's other samples, where the warp covers the whole pixel; the background
    /// elsewhere. A pixel of constant radiance then has no variance.
    PixelMean,
    /// The background, for all pixels. It is also correct at the outline of the bounding sphere,
    /// where V ends and all radiance is background.
    Background,
    /// c = 0, as published. In front of a background that is not black, it is wrong at the outline
    /// of the bounding sphere.
    None,
}
