//! `cargo xtask figures`: the measured figures of the documentation.

mod detail;
mod estimators;
mod filters;
mod math;
mod steps;

use std::path::PathBuf;

use anyhow::Context;

use sweep::measure::{dsdf, workspace_root};

/// A figure of the documentation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Figure {
    /// Error against seconds, of every estimator on every scene of the gradient suite
    Estimators,
    /// Error against the number N of points along a ray, `paper` against `refined`
    Steps,
    /// Variance with a Gaussian filter against a box filter with its boundary integral, by pixel
    Filters,
    /// Chamfer distance and error of normals against seconds of a fit, with and without a grid, on
    /// two data sets of renders that are not in the repository; the fits take 31 minutes
    Detail,
    /// The drawings of docs/math, and derivative images of a disc against its closed form
    Math,
}

/// Measures a figure and writes it into the folder `output`.
pub(crate) fn run(figure: Figure, output: Option<PathBuf>) -> anyhow::Result<()> {
    let name = match figure {
        Figure::Estimators => "estimators",
        Figure::Steps => "steps",
        Figure::Filters => "filters",
        Figure::Detail => "detail",
        Figure::Math => "math",
    };
    let folder = output.unwrap_or_else(|| workspace_root().join("docs/results").join(name));
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let binary = dsdf::build()?;
    match figure {
        Figure::Estimators => estimators::run(&binary, &folder),
        Figure::Steps => steps::run(&binary, &folder),
        Figure::Filters => filters::run(&binary, &folder),
        Figure::Detail => detail::run(&binary, &folder),
        Figure::Math => math::run(&binary, &folder),
    }?;
    eprintln!("{}", folder.display());
    Ok(())
}
