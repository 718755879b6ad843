//! Independent replicates of an image, for standard errors, and tiles of pixels that are sampled
//! together.

use field::Real;
use random::{Name, Stream};
use render::{Camera, Pixel, Scene};
use trace::Lattice;

use crate::{Batch, Estimator, SampleCounts, Terms};

const REPLICATE: Name = Name::new("replicates of an image", 1);

/// Numbers of samples with their seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// The numbers of samples.
    pub counts: SampleCounts,
    /// The seed of the samples.
    pub seed: u64,
}

/// The samples of a tile, about: enough to fill the field's blocks of points, few enough to stay in
/// the caches and to balance threads.
const TILE_SAMPLES: usize = 1024;

/// The largest side of a tile, in pixels.
const LARGEST_TILE: usize = 32;

/// The least number of replicates, if there are enough samples.
const REPLICATES: u32 = 4;

/// The largest number of samples of a pixel in one replicate: they are in memory together.
const LONGEST_REPLICATE: u32 = 1024;

/// An image in double precision, row-major.
pub(crate) type Image = Vec<[f64; 3]>;

impl Sampling {
    /// The random numbers of the samples.
    pub(crate) fn stream(self) -> Stream {
        Stream::of_seed(self.seed)
    }

    /// Independent parts that have the same total number of samples, each with random numbers of
    /// its own; one part if the estimator does not depend on the seed.
    pub(crate) fn replicates(self, depends_on_seed: bool) -> Vec<Replicate> {
        let SampleCounts { spp, edge_samples } = self.counts;
        let enough = REPLICATES.max(spp.max(edge_samples).div_ceil(LONGEST_REPLICATE));
        let most = enough.min(spp).min(edge_samples.max(2));
        let replicates = if depends_on_seed { most } else { 1 };
        let share =
            |total: u32, r: u32| (total / replicates + u32::from(r < total % replicates)).max(1);
        let part = |r: u32| Replicate {
            counts: SampleCounts { spp: share(spp, r), edge_samples: share(edge_samples, r) },
            stream: self.stream().named(REPLICATE).at(u64::from(r)),
        };
        (0..replicates).map(part).collect()
    }
}

/// A lattice of the scene's field for samples of the first camera, if it saves time and if the
/// estimator ignores far closest approaches.
pub(crate) fn lattice<R: Real>(
    scene: &Scene<'_, R>,
    estimator: &dyn Estimator<R>,
    SampleCounts { spp, .. }: SampleCounts,
) -> Option<(Lattice<R>, f64)> {
    let reach = estimator.reach()?;
    let camera = &scene.cameras[0];
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    Some((scene.lattice_for(pixels * u64::from(spp))?, reach))
}

/// The scene with a lattice and its reach, if there is one.
pub(crate) fn with_lattice<'a, R: Real>(
    scene: &Scene<'a, R>,
    lattice: Option<&'a (Lattice<R>, f64)>,
) -> Scene<'a, R> {
    lattice.map_or(*scene, |(lattice, reach)| scene.with_lattice(Some(lattice), *reach))
}

/// An independent part of the samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Replicate {
    pub(crate) counts: SampleCounts,
    pub(crate) stream: Stream,
}

impl Replicate {
    /// The batch of `pixels` with these samples.
    pub(crate) fn batch(self, pixels: &[Pixel], terms: Terms) -> Batch<'_> {
        Batch { pixels, counts: self.counts, stream: self.stream, terms }
    }

    /// The same samples for a caller that samples by itself.
    pub(crate) fn sampling(self) -> Sampling {
        Sampling { counts: self.counts, seed: self.stream.bits() }
    }
}

/// The film of a scene's first camera in square tiles. Most edges between pixels lie inside a tile,
/// unless a single pixel has as many samples as a tile.
pub(crate) fn tiles(
    camera: &Camera,
    counts: SampleCounts,
    memory_factor: usize,
) -> Vec<Vec<Pixel>> {
    let (width, height) = (camera.width, camera.height);
    let samples = counts.spp.max(counts.edge_samples) as usize * memory_factor;
    let side = (TILE_SAMPLES / samples).isqrt().clamp(1, LARGEST_TILE) as u32;
    let step = side as usize;
    (0..height)
        .step_by(step)
        .flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)))
        .map(|(x0, y0)| {
            let columns = x0..(x0 + side).min(width);
            (y0..(y0 + side).min(height))
                .flat_map(|y| columns.clone().map(move |x| Pixel { camera: 0, x, y }))
                .collect()
        })
        .collect()
}

/// The weighted mean of replicates of some pixels, with their terms of its standard error.
pub(crate) struct Mean {
    pub(crate) pixels: Vec<[f32; 3]>,
    /// The sum of the squares of the mean.
    square: f64,
    /// The sum of the squares of the replicates' weighted deviations from the mean.
    deviation: f64,
}

impl Mean {
    /// The mean of `value(r, i)` over replicates r of weight `weights[r]`, for `count` pixels i.
    pub(crate) fn of(
        count: usize,
        weights: &[f64],
        value: impl Fn(usize, usize) -> [f64; 3],
    ) -> Self {
        let total: f64 = weights.iter().sum();
        let (mut square, mut deviation) = (0.0, 0.0);
        let mut pixel = |i: usize| {
            let weighted = || weights.iter().enumerate().map(|(r, w)| (w, value(r, i)));
            std::array::from_fn(|c| {
                let mean = weighted().map(|(w, value)| w * value[c]).sum::<f64>() / total;
                square += mean * mean;
                deviation += weighted()
                    .map(|(w, value)| (w * (value[c] - mean) / total).powi(2))
                    .sum::<f64>();
                mean as f32
            })
        };
        let pixels = (0..count).map(&mut pixel).collect();
        Mean { pixels, square, deviation }
    }

    /// The L2 norm of the standard error of an image, relative to that of the image, from the means
    /// of its parts; `None` for one replicate.
    pub(crate) fn standard_error<'a>(
        parts: impl Iterator<Item = &'a Mean>,
        replicates: usize,
    ) -> Option<f64> {
        let n = replicates as f64;
        let (square, deviation) =
            parts.fold((0.0, 0.0), |(a, b), part| (a + part.square, b + part.deviation));
        let relative = if square > 0.0 { (deviation * n / (n - 1.0) / square).sqrt() } else { 0.0 };
        (replicates > 1).then_some(relative)
    }
}
