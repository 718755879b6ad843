//! A chunk of the batch of an iteration, with its coefficients and sums.

use estimate::record::{Adjoints, CameraAdjoints, Pass};
use estimate::{Estimator, SampleCounts};
use glam::{DVec2, DVec3, Vec3};
use random::{Purpose, Stream};
use render::{Sample, Scene};
use stereo::Guide;

use photometry::{Level, Pixel, photometric, squared_error};

/// The batch of an iteration: its pixels, and all inputs of their loss.
pub(crate) struct Batch<'a> {
    /// The model, with the cameras of the level.
    pub(crate) scene: Scene<'a, f32>,
    /// The level of the pyramid, with the photographs.
    pub(crate) level: &'a Level,
    /// The drawn pixels.
    pub(crate) pixels: &'a [Pixel],
    /// The expected number of pixels that the draws stand for. With the drawn number in its place,
    /// the mean would be a ratio of two random numbers, which is biased.
    pub(crate) pixel_count: f32,
    /// Whether the background is trained.
    pub(crate) trains_background: bool,
    /// Whether the adjoints of the cameras are wanted.
    pub(crate) refines_cameras: bool,
    /// The radiance behind the object in each view, if the photographs are over black; else empty.
    pub(crate) behind: &'a [Vec3],
    /// The gain of each photograph, if they are fitted; else empty.
    pub(crate) gains: &'a [Vec3],
    /// The weight of the eikonal term.
    pub(crate) eikonal: f32,
    /// The estimator of pixels that a silhouette may cross.
    pub(crate) estimator: &'a dyn Estimator<f32>,
    /// The numbers of samples in such a pixel.
    pub(crate) counts: SampleCounts,
    /// The way in which the coefficients of samples are added up.
    pub(crate) pass: Pass<f32>,
    /// The sharpness of the surface, per bounding radius, while it is soft; `None` for a surface of
    /// its own.
    pub(crate) sharpness: Option<f32>,
    /// The depths of the photographs, which guide a soft surface.
    pub(crate) depths: Option<Guide<'a>>,
    /// Whether surfaces that photographs contradict go back.
    pub(crate) carves: bool,
    /// The seed of this iteration.
    pub(crate) seed: u64,
}

/// Sums over a batch.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BatchStats {
    /// The number of pixels that the batch stands for.
    pub(crate) pixels: u64,
    /// The photometric loss, over the pixels.
    pub(crate) photometric: f64,
    /// (|∇f| − 1)², over the points of the eikonal term.
    pub(crate) eikonal: f64,
    /// The number of points of the eikonal term.
    pub(crate) eikonal_points: u64,
    /// The squared error in display units, over the pixels.
    pub(crate) squared_error: f64,
    /// The number of pixels that a silhouette may cross.
    pub(crate) edge_pixels: u64,
    /// The number of traced rays.
    pub(crate) rays: u64,
}

impl BatchStats {
    /// Adds the sums of another part of the batch.
    pub(crate) fn add(&mut self, o: &BatchStats) {
        self.pixels += o.pixels;
        self.photometric += o.photometric;
        self.eikonal += o.eikonal;
        self.eikonal_points += o.eikonal_points;
        self.squared_error += o.squared_error;
        self.edge_pixels += o.edge_pixels;
        self.rays += o.rays;
    }
}

/// The number of pixels that these draws stand for.
pub(super) fn pixels_of(draws: &[Pixel]) -> u64 {
    draws.iter().map(|p| u64::from(p.count)).sum()
}

/// A part of a batch, with the coefficients and sums of the terms so far.
pub(super) struct Chunk<'a> {
    pub(super) batch: &'a Batch<'a>,
    pub(super) pixels: &'a [Pixel],
    pub(super) seed: u64,
    /// 1 over the expected number of pixels that the batch stands for.
    pub(super) share: f32,
    pub(super) adjoints: Adjoints<f32>,
    /// The adjoints of the natural logarithms of the gains.
    pub(super) gains: Vec<DVec3>,
    pub(super) stats: BatchStats,
}

impl<'a> Chunk<'a> {
    pub(super) fn new(batch: &'a Batch<'a>, pixels: &'a [Pixel], seed: u64) -> Self {
        let share = 1.0 / batch.pixel_count;
        let cameras = batch.refines_cameras.then(|| {
            let of_pixel = pixels.iter().map(|p| p.view as usize).collect();
            CameraAdjoints::new(of_pixel, batch.scene.cameras.len())
        });
        let adjoints = Adjoints { cameras, ..Adjoints::default() };
        let (gains, stats) = (vec![DVec3::ZERO; batch.gains.len()], BatchStats::default());
        Chunk { batch, pixels, seed, share, adjoints, gains, stats }
    }

    /// One uniform random sample in every pixel.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let stream = Stream::new(self.seed, Purpose::FitSamples);
        let place = |(i, p): (usize, &Pixel)| {
            let [a, b] = [0, 1].map(|d| stream.at(i as u64).at(d).unit());
            let u = DVec2::new(f64::from(p.x) + a, f64::from(p.y) + b);
            Sample { camera: p.view as usize, u }
        };
        self.pixels.iter().enumerate().map(place).collect()
    }

    /// Adds the loss of one pixel to the sums, and returns the adjoint of its radiance, and the
    /// loss.
    pub(super) fn add_loss(&mut self, radiance: [f32; 3], p: Pixel) -> (Vec3, f32) {
        let view = p.view as usize;
        let photograph = &self.batch.level.photographs[view];
        let behind = self.batch.behind.get(view).copied().unwrap_or_default();
        let target = photograph.target(behind, &p);
        let gain = self.batch.gains.get(view).copied().unwrap_or(Vec3::ONE);
        let shown = Vec3::from(radiance) * gain;
        let (loss, adjoint) = photometric(shown.into(), &target);
        let count = f64::from(p.count);
        self.stats.photometric += f64::from(loss) * count;
        self.stats.squared_error += f64::from(squared_error(shown.into(), target.radiance)) * count;
        let adjoint = Vec3::from(adjoint) * (self.share * f32::from(p.count));
        if let Some(sum) = self.gains.get_mut(view) {
            *sum += (adjoint * shown).as_dvec3();
        }
        (adjoint * gain, loss)
    }
}
