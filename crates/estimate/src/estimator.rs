//! The trait that every estimator implements.

use field::Real;
use render::{InvalidField, Pixel, Scene};

use crate::record::Record;

/// The filter over which a pixel's value is the mean of radiance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The pixel's unit square.
    Box,
    /// A Gaussian about the pixel's centre, with a standard deviation of [`FILTER_DEVIATION`].
    Gaussian,
}

/// The standard deviation of the Gaussian filter, in pixels.
pub const FILTER_DEVIATION: f64 = 0.5;

/// Numbers of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleCounts {
    /// Samples a pixel.
    pub spp: u32,
    /// Samples on each edge between pixels; for `refined`, lines along each axis of a pixel.
    pub edge_samples: u32,
}

/// The terms of a pixel's derivative that a record has to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Terms {
    /// All terms, and the pixels' values.
    All,
    /// Silhouettes at least. The caller knows that all other terms are zero, as for a radiance that
    /// is the same everywhere; an estimator may leave out the pixels' values too.
    Silhouettes,
}

/// Pixels to sample.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// The pixels.
    pub pixels: &'a [Pixel],
    /// How many samples they get.
    pub counts: SampleCounts,
    /// The seed of the samples.
    pub seed: u64,
    /// The terms that are wanted.
    pub terms: Terms,
}

/// For each pixel of a batch, whether a silhouette may cross it.
///
/// Further samples of the same pixels start from the mask of earlier ones, so that they need not
/// find it again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SilhouetteMask {
    /// One flag a pixel; empty before anything is known.
    pub may_cross: Vec<bool>,
}

impl SilhouetteMask {
    /// A silhouette may cross each of `pixels` pixels.
    pub fn all(pixels: usize) -> Self {
        SilhouetteMask { may_cross: vec![true; pixels] }
    }
}

/// A way to differentiate pixel values.
///
/// An estimator samples pixels and returns a [`Record`]: all that is linear in the adjoints of the
/// pixels. Derivative images, gradients of image losses and fits read the same record, so an
/// estimator is written once. To use one by name, add it to a [`crate::Registry`].
pub trait Estimator<R: Real>: Send + Sync {
    /// The filter of the image whose derivative this is.
    fn filter(&self) -> Filter {
        Filter::Box
    }

    /// Samples pixels. The same batch gives the same bits.
    ///
    /// `mask` tells which pixels a silhouette may cross, where that is known; an estimator that
    /// looks for them adds to it, any other ignores it.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity.
    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        mask: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField>;

    /// Whether other seeds give other samples. If not, there are no replicates to estimate a
    /// standard error from.
    fn depends_on_seed(&self) -> bool {
        true
    }

    /// Memory of one sample relative to a sample without a quadrature along its ray: sets how many
    /// pixels are sampled together.
    fn memory_factor(&self) -> usize {
        1
    }
}
