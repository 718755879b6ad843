//! A late stage of an iteration: the adjoints of a part of the pixels, down to coefficients of f and
//! ∇f at points.

use estimate::record::{Adjoints, CameraAdjoints, PointAdjoint};
use glam::{DVec3, Vec3};

use crate::drawn::Drawn;
use crate::objective::{Objective, PixelLoss};
use crate::photometry::Draw;
use crate::stats::BatchStats;
use crate::sums::PartSums;

/// The adjoints and sums of a part of the pixels.
pub(crate) struct Reversed {
    /// Coefficients at points that belong to no record: of a soft surface, and of regularisers.
    pub(crate) points: Vec<PointAdjoint<f32>>,
    /// Coefficients at points of records, and adjoints of the cameras. They come after `points`.
    pub(crate) records: Adjoints<f32>,
    /// The gradient by the parameters.
    pub(crate) sums: PartSums,
    /// The adjoints of the natural logarithms of the gains.
    pub(crate) gains: Vec<DVec3>,
    pub(crate) stats: BatchStats,
}

impl Reversed {
    /// Nothing so far; `sums` are zero.
    pub(crate) fn new(drawn: &Drawn<'_>, sums: PartSums) -> Self {
        let objective = drawn.objective;
        let cameras = || CameraAdjoints::new(Vec::new(), objective.scene.cameras.len());
        Reversed {
            points: Vec::new(),
            records: Adjoints {
                cameras: objective.wanted.cameras.then(cameras),
                ..Adjoints::default()
            },
            sums,
            gains: vec![DVec3::ZERO; objective.targets.gains.len()],
            stats: BatchStats::default(),
        }
    }

    /// Adds α f(x) with the coefficient α.
    pub(crate) fn push_value(&mut self, x: Vec3, alpha: f32) {
        self.points.push(PointAdjoint { x, alpha, c: Vec3::ZERO });
    }

    /// Adds c·∇f(x) with the coefficient c.
    pub(crate) fn push_gradient(&mut self, x: Vec3, c: Vec3) {
        self.points.push(PointAdjoint { x, alpha: 0.0, c });
    }

    /// Adds the loss of one pixel to the sums, and returns the adjoint of its radiance.
    pub(crate) fn add_loss(
        &mut self,
        objective: &Objective<'_>,
        own: &PixelLoss,
        draw: &Draw,
    ) -> Vec3 {
        let count = f64::from(draw.count);
        self.stats.photometric += f64::from(own.loss) * count;
        self.stats.squared_error += f64::from(own.squared_error) * count;

        let adjoint = own.adjoint * (objective.pixel_weight() * f32::from(draw.count));
        if let Some(sum) = self.gains.get_mut(draw.view as usize) {
            *sum += (adjoint * own.shown).as_dvec3();
        }
        adjoint * objective.targets.gain(draw)
    }
}
