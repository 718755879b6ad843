//! Texts and numbers about a run that `dsdf fit` and `dsdf inspect` share.

use ::inspect::{Evidence, Verdict};
use dataset::Dataset;
use fit::{Model, RunFile, Solid};
use render::Camera;

/// The origin of a bounding sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BoundsFrom {
    /// The option `--bounds`.
    Option,
    /// The `fit.toml` of a run.
    Run,
    /// The data set itself.
    Dataset,
    /// An estimate.
    Estimate,
}

impl BoundsFrom {
    /// The origin for a data set, `asked` with the option `--bounds`.
    pub(super) fn of(asked: bool, dataset: &Dataset) -> Self {
        match (asked, dataset.bounds) {
            (true, _) => BoundsFrom::Option,
            (false, Some(_)) => BoundsFrom::Dataset,
            (false, None) => BoundsFrom::Estimate,
        }
    }

    /// The origin in words.
    pub(super) fn text(self) -> &'static str {
        match self {
            BoundsFrom::Option => "as asked",
            BoundsFrom::Run => "from the run",
            BoundsFrom::Dataset => "from the data set",
            BoundsFrom::Estimate => "estimated from cameras and background",
        }
    }
}

/// The verdict on a run. The data set is relative to the run's origin.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(super) fn examine(model: &Model, file: &RunFile, dataset: &Dataset) -> anyhow::Result<Verdict> {
    let views = dataset.train.iter().chain(&dataset.test);
    let cameras: Vec<Camera> = views.map(|view| view.camera).collect();
    let solid = Solid::new(model, file);
    let scene = solid.scene(&cameras);
    let evidence = Evidence::collect(&scene, &file.sphere(), dataset, &file.background())?;
    Ok(Verdict::of(evidence))
}
