//! The trait that every estimator implements.

use field::Real;
use random::Stream;
use render::{InvalidField, Pixel, Scene};

use crate::discontinuity::Discontinuity;
use crate::record::Record;

/// The pixel filter: the value of a pixel is the mean of the radiance, weighted by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// A constant over the pixel's unit square.
    Box,
    /// A Gaussian around the pixel's centre, with a standard deviation of [`FILTER_DEVIATION`].
    Gaussian,
}

/// The standard deviation of the Gaussian filter, in pixels.
pub const FILTER_DEVIATION: f64 = 0.5;

/// Numbers of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleCounts {
    /// Samples per pixel.
    pub spp: u32,
    /// Samples on each edge between pixels; for `refined`, lines per pixel along each film axis.
    pub edge_samples: u32,
}

/// The terms of a pixel's derivative that a record has to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Terms {
    /// All terms, and the pixels' values.
    All,
    /// The silhouette terms. The caller knows that all other terms are zero, for example because
    /// the radiance is the same everywhere. An estimator may also leave out the pixels' values.
    Silhouettes,
}

/// A batch of pixels to sample.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// The pixels.
    pub pixels: &'a [Pixel],
    /// Their numbers of samples.
    pub counts: SampleCounts,
    /// The random numbers of the samples.
    pub stream: Stream,
    /// The terms that are wanted.
    pub terms: Terms,
}

/// For each pixel of a batch, whether a silhouette may cross it.
///
/// Further samples of the same pixels start from the mask of the earlier ones, and skip the search
/// for it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SilhouetteMask {
    /// One flag per pixel of the batch; empty before the first samples.
    pub may_cross: Vec<bool>,
}

impl SilhouetteMask {
    /// The mask of `pixels` pixels that silhouettes may all cross.
    pub fn all(pixels: usize) -> Self {
        SilhouetteMask { may_cross: vec![true; pixels] }
    }
}

/// A method to differentiate pixel values.
///
/// An estimator samples pixels and returns a [`Record`]. The record holds all terms of the
/// derivative, and each term is linear in the adjoints of the pixels. Derivative images, gradients
/// of image losses and fits read the same record. To select an estimator by name, add it to a
/// [`crate::Registry`].
pub trait Estimator<R: Real>: Send + Sync {
    /// The pixel filter of the image that is differentiated.
    fn filter(&self) -> Filter {
        Filter::Box
    }

    /// Samples the pixels of a batch. The same batch and mask give the same bits.
    ///
    /// The batch may have no pixels. The record names pixels by their index in the batch, and has
    /// one radiance per pixel.
    ///
    /// `mask` is empty, or has one flag per pixel from earlier samples of the same pixels.
    /// An estimator that tests which pixels a silhouette may cross adds flags to it; others ignore
    /// it.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        mask: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField>;

    /// The discontinuities of this scene whose motion the estimator leaves out: the derivative
    /// lacks these terms, and no standard error shows it.
    ///
    /// By default all that the scene can have except silhouettes. An estimator that covers others
    /// too, or does not cover silhouettes, says so here.
    fn unmodelled(&self, scene: &Scene<'_, R>) -> Vec<Discontinuity> {
        Discontinuity::of_scene_except(scene, &[Discontinuity::Silhouettes])
    }

    /// Whether the records have the derivatives by cameras: those of estimators that find points of
    /// silhouettes do. A warp's do not.
    fn differentiates_cameras(&self) -> bool {
        false
    }

    /// Whether the samples of a pixel depend on no other pixel of the batch, and records have
    /// neither border nor warp. A record can then be dealt to parts ([`Record::deal`]), and the
    /// parts have the same bits as records of their own. Samples of a warp depend on the edges that
    /// pixels share.
    fn is_by_pixel(&self) -> bool {
        false
    }

    /// The largest clearance of a closest approach that the estimator takes notice of, in pixels;
    /// `None` if it notices all. Rays may leave out others: see [`Scene::lattice`].
    fn reach(&self) -> Option<f64> {
        None
    }

    /// Whether other seeds give other samples. Without that, there are no independent replicates,
    /// and no standard error.
    fn depends_on_seed(&self) -> bool {
        true
    }

    /// The memory of one sample, relative to that of a ray without points of a warp. It limits the
    /// number of pixels that are sampled together.
    fn memory_factor(&self) -> usize {
        1
    }
}
