//! The batch of an iteration, and sums over it.

use crate::photometry::{Level, Pixel, photometric, squared_error};
use estimate::record::Pass;
use estimate::{Estimator, SampleCounts};
use glam::Vec3;
use multiview::stereo::Guide;
use render::Scene;

/// The batch of an iteration: its pixels, and all inputs of their loss.
pub struct Batch<'a> {
    /// The model, with the cameras of the level.
    pub scene: Scene<'a, f32>,
    /// The level of the pyramid, with the photographs.
    pub level: &'a Level,
    /// The drawn pixels.
    pub pixels: &'a [Pixel],
    /// The expected number of pixels that the draws stand for. With the drawn number in its place,
    /// the mean would be a ratio of two random numbers, which is biased.
    pub pixel_count: f32,
    /// Whether the background is trained.
    pub trains_background: bool,
    /// Whether the adjoints of the cameras are wanted.
    pub refines_cameras: bool,
    /// The radiance behind the object in each view, if the photographs are over black; else empty.
    pub behind: &'a [Vec3],
    /// The gain of each photograph, if they are fitted; else empty.
    pub gains: &'a [Vec3],
    /// The weight of the eikonal term.
    pub eikonal: f32,
    /// The weight of the bending term.
    pub bending: f32,
    /// The estimator of pixels that a silhouette may cross.
    pub estimator: &'a dyn Estimator<f32>,
    /// The numbers of samples in such a pixel.
    pub counts: SampleCounts,
    /// The way in which the coefficients of samples are added up.
    pub pass: Pass<f32>,
    /// The sharpness of the surface, per bounding radius, while it is soft; `None` for a surface of
    /// its own.
    pub sharpness: Option<f32>,
    /// The depths of the photographs, which guide a soft surface.
    pub depths: Option<Guide<'a>>,
    /// Whether surfaces that photographs contradict go back.
    pub carves: bool,
    /// The seed of this iteration.
    pub seed: u64,
}

/// Sums over a batch.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatchStats {
    /// The number of pixels that the batch stands for.
    pub pixels: u64,
    /// The photometric loss, over the pixels.
    pub photometric: f64,
    /// (|∇f| − 1)², over the points of the eikonal term.
    pub eikonal: f64,
    /// The number of points of the eikonal term.
    pub eikonal_points: u64,
    /// The squared error in display units, over the pixels.
    pub squared_error: f64,
    /// The number of pixels that a silhouette may cross.
    pub edge_pixels: u64,
    /// The number of traced rays.
    pub rays: u64,
}

impl BatchStats {
    /// Adds the sums of another part of the batch.
    pub fn add(&mut self, o: &BatchStats) {
        self.pixels += o.pixels;
        self.photometric += o.photometric;
        self.eikonal += o.eikonal;
        self.eikonal_points += o.eikonal_points;
        self.squared_error += o.squared_error;
        self.edge_pixels += o.edge_pixels;
        self.rays += o.rays;
    }
}

/// The loss of one pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelLoss {
    /// The photometric loss.
    pub(crate) loss: f32,
    /// The squared error in display units.
    pub(crate) squared_error: f32,
    /// The derivative of the loss by the shown radiance.
    pub(crate) adjoint: Vec3,
    /// The radiance times the gain of the photograph.
    pub(crate) shown: Vec3,
}

impl Batch<'_> {
    /// The gain of a pixel's photograph.
    pub(crate) fn gain(&self, p: &Pixel) -> Vec3 {
        self.gains.get(p.view as usize).copied().unwrap_or(Vec3::ONE)
    }

    /// The loss of a pixel with this radiance.
    pub(crate) fn loss(&self, radiance: Vec3, p: &Pixel) -> PixelLoss {
        let view = p.view as usize;
        let behind = self.behind.get(view).copied().unwrap_or_default();
        let target = self.level.photographs[view].target(behind, p);
        let shown = radiance * self.gain(p);
        let (loss, adjoint) = photometric(shown.into(), &target);
        let squared_error = squared_error(shown.into(), target.radiance);
        PixelLoss { loss, squared_error, adjoint: adjoint.into(), shown }
    }
}
