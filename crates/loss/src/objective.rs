//! The loss of an iteration: its pixels, and all inputs of their loss.

use estimate::record::Pass;
use estimate::{Estimator, SampleCounts};
use glam::Vec3;
use multiview::stereo::{Consistency, Guide};
use random::Stream;
use render::Scene;

use crate::photometry::{Draw, Level, photometric, squared_error};

/// The loss of an iteration: the drawn pixels, and all inputs of their loss. [`gradient`] computes
/// its gradient.
///
/// [`gradient`]: crate::gradient()
#[derive(Clone, Copy)]
pub struct Objective<'a> {
    /// The model, with the cameras of the level.
    pub scene: Scene<'a, f32>,
    /// The photographs.
    pub targets: Targets<'a>,
    /// The drawn pixels.
    pub draws: &'a [Draw],
    /// The expected number of pixels that the draws stand for. With the drawn number in its place,
    /// the mean would be a ratio of two random numbers, which is biased.
    pub pixel_count: f32,
    /// The kind of the surface.
    pub surface: Surface<'a>,
    /// The terms beside the photographs, in the order in which they are added.
    pub regularisers: &'a [Regulariser],
    /// Depths of the photographs, if surface that contradicts the photographs is removed. A surface
    /// at a known depth stays.
    pub carving: Option<Guide<'a>>,
    /// The comparison of photographs at the points of a sharp surface, if there is one.
    pub patches: Option<Patches<'a>>,
    /// The derivatives that are wanted beside those of field and radiance.
    pub wanted: Wanted,
    /// The random numbers of this iteration.
    pub stream: Stream,
}

/// The term of patches; see the file `patches.rs`.
#[derive(Clone, Copy, Debug)]
pub struct Patches<'a> {
    /// The photographs, with the cameras of the scene.
    pub consistency: &'a Consistency,
    /// The weight of the term where radiance explains little of the photographs.
    pub weight: f32,
    /// The factor on the weight where radiance explains the photographs: 1 for no fall.
    pub fall: f32,
}

/// Photographs at one size as the target of an objective.
#[derive(Clone, Copy, Debug)]
pub struct Targets<'a> {
    /// The level of the pyramid, with the photographs.
    pub level: &'a Level,
    /// The radiance behind the object in each view, if the photographs are over black; else empty.
    pub behind: &'a [Vec3],
    /// The gain of each photograph, if they are fitted; else empty.
    pub gains: &'a [Vec3],
}

/// The kind of a surface: it decides how rays see it.
#[derive(Clone, Copy)]
pub enum Surface<'a> {
    /// A surface with opacity around it: it can appear and vanish.
    Soft {
        /// The sharpness, per bounding radius.
        sharpness: f32,
        /// The depths of the photographs, which guide the surface.
        depths: Option<Guide<'a>>,
    },
    /// A surface with hits and silhouettes.
    Sharp {
        /// The estimator of pixels that a silhouette may cross.
        estimator: &'a dyn Estimator<f32>,
        /// The numbers of samples in such a pixel.
        counts: SampleCounts,
        /// The way in which the coefficients of samples are added up.
        pass: Pass<f32>,
    },
}

/// A term of the loss that does not need photographs, with its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Regulariser {
    /// (|∇f| − 1)² near the surface and in the bounding ball; see the file `eikonal.rs`.
    Eikonal(f32),
    /// The total variation of normals where photographs are even; see the file `bending.rs`.
    Bending(f32),
}

/// Derivatives that are wanted beside those of field and radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// By the parameters of the background.
    pub background: bool,
    /// By the cameras.
    pub cameras: bool,
}

impl std::fmt::Debug for Objective<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Objective { draws, surface, regularisers, wanted, .. } = self;
        f.debug_struct("Objective")
            .field("draws", &draws.len())
            .field("surface", surface)
            .field("regularisers", regularisers)
            .field("wanted", wanted)
            .finish_non_exhaustive()
    }
}

impl std::fmt::Debug for Surface<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Surface::Soft { sharpness, .. } => {
                f.debug_struct("Soft").field("sharpness", sharpness).finish_non_exhaustive()
            }
            Surface::Sharp { counts, pass, .. } => {
                let mut shown = f.debug_struct("Sharp");
                shown.field("counts", counts).field("pass", pass).finish_non_exhaustive()
            }
        }
    }
}

impl<'a> Objective<'a> {
    /// The photometric loss of these pixels alone, each with the same weight: no regularisers, no
    /// exposures, no carving, no patches, and the derivatives of field and radiance.
    pub fn photometric(
        scene: Scene<'a, f32>,
        level: &'a Level,
        draws: &'a [Draw],
        surface: Surface<'a>,
    ) -> Self {
        Objective {
            scene,
            targets: Targets { level, behind: &[], gains: &[] },
            draws,
            pixel_count: draws.len() as f32,
            surface,
            regularisers: &[],
            carving: None,
            patches: None,
            wanted: Wanted::default(),
            stream: Stream::of_seed(0),
        }
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

impl Targets<'_> {
    /// The gain of a pixel's photograph.
    pub(crate) fn gain(&self, draw: &Draw) -> Vec3 {
        self.gains.get(draw.view as usize).copied().unwrap_or(Vec3::ONE)
    }

    /// The loss of a pixel with this radiance.
    pub(crate) fn loss(&self, radiance: Vec3, draw: &Draw) -> PixelLoss {
        let view = draw.view as usize;
        let behind = self.behind.get(view).copied().unwrap_or_default();
        let target = self.level.photographs[view].target(behind, draw);
        let shown = radiance * self.gain(draw);

        let (loss, adjoint) = photometric(shown.into(), &target);
        let squared_error = squared_error(shown.into(), target.radiance);
        PixelLoss { loss, squared_error, adjoint: adjoint.into(), shown }
    }
}
