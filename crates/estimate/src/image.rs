//! Derivative images: d(pixel)/d(number), forward mode.

use field::{Real, SurfaceAdjoint, SurfaceBatch, Vector3};
use rayon::prelude::*;

use super::primary::PUBLISHED_STEPS;
use super::{Adjoints, Area, Control, Estimator, Method, Pass, Pixel, Record, Setup, Survey};
use crate::InvalidField;
use film::Film;
use random::{gaussian, mix, unit as unit_number};

/// What an image is differentiated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// A parameter of the field.
    Field(usize),
    /// All parameters of the field at once, along the random unit vector of this number.
    Along(u64),
    /// A parameter of the shader.
    Shader(usize),
    /// A channel of the background.
    Background(usize),
}

/// What is sampled, and how much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// The estimator.
    pub method: Method,
    /// Samples a pixel.
    pub spp: u32,
    /// Samples on each edge between pixels.
    pub edge_samples: u32,
    /// Seed of the samples.
    pub seed: u64,
}

/// A derivative image.
#[derive(Clone, Debug)]
pub struct Derivative {
    /// d(pixel)/d(number), linear RGB per unit of the number.
    pub film: Film,
    /// The estimated standard error: relative L2 over the image, from independent replicates;
    /// `None` for one sample.
    pub standard_error: Option<f64>,
}

/// The samples of a tile: enough to fill the field's blocks, few enough to stay in the caches and
/// to balance threads.
const TILE_SAMPLES: usize = 1024;

/// The largest side of a tile, in pixels.
const LARGEST_TILE: usize = 32;

/// Independent replicates that samples are divided over, for the standard error.
const REPLICATES: u32 = 4;

/// Samples of a pixel in one replicate at most: they are in memory together.
const LONGEST_REPLICATE: u32 = 1024;

pub(super) type Image = Vec<[f64; 3]>;

impl Sampling {
    /// Independent parts of the same total, for standard errors: each with its number of samples.
    pub(super) fn replicates(self) -> Vec<Sampling> {
        // A grid is the same for every seed.
        let enough = REPLICATES.max(self.spp.max(self.edge_samples).div_ceil(LONGEST_REPLICATE));
        let most = enough.min(self.spp).min(self.edge_samples.max(2));
        let replicates = if self.method == Method::Contour { 1 } else { most };
        let share =
            |total: u32, r: u32| (total / replicates + u32::from(r < total % replicates)).max(1);
        let part = |r: u32| Sampling {
            spp: share(self.spp, r),
            edge_samples: share(self.edge_samples, r),
            seed: mix(self.seed, u64::from(r)),
            ..self
        };
        (0..replicates).map(part).collect()
    }

    /// The estimator.
    ///
    /// # Panics
    /// For finite differences, which are none of a field.
    pub(super) fn estimator<R: Real>(&self) -> Box<dyn Estimator<R>> {
        let estimator = self.method.estimator(self.spp, self.edge_samples, Control::Background);
        estimator.unwrap_or_else(|| panic!("{} needs a scene", self.method.name()))
    }
}

/// Differentiates the image of the setup's first camera in each direction.
///
/// # Errors
/// If the field gives a NaN or an infinity.
///
/// # Panics
/// For finite differences, which are none of a field.
pub fn differentiate<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Derivative>, InvalidField> {
    let of_field =
        |direction: &Direction| matches!(direction, Direction::Field(_) | Direction::Along(_));
    let smooth = !setup.shader.is_uniform() || !directions.iter().all(of_field);
    let setup = &Setup { smooth, ..*setup };
    let parts = sampling.replicates();
    let estimators: Vec<_> = parts.iter().map(Sampling::estimator::<R>).collect();
    let camera = &setup.cameras[0];
    let tiles = tiles(camera.width, camera.height, parts[0], setup.steps);
    let done = std::sync::atomic::AtomicUsize::new(0);
    let weights: Vec<f64> = parts.iter().map(|part| f64::from(part.spp)).collect();
    // The derivatives of each tile, by direction.
    let of_tile: Vec<Vec<Mean>> = tiles
        .par_iter()
        .map(|pixels| {
            let mut survey = Survey::default();
            let mut images = Vec::with_capacity(parts.len());
            for (estimator, part) in estimators.iter().zip(&parts) {
                let record = estimator.record_surveyed(setup, pixels, part.seed, &mut survey)?;
                images.push(forward(setup, &record, pixels.len(), directions));
            }
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress(done as f64 / tiles.len() as f64);
            Ok((0..directions.len())
                .map(|d| Mean::of(pixels.len(), &weights, |r, i| images[r][d][i]))
                .collect())
        })
        .collect::<Result<_, _>>()?;
    Ok((0..directions.len())
        .map(|d| {
            let mut film = Film::new(camera.width, camera.height);
            for (pixels, means) in tiles.iter().zip(&of_tile) {
                for (pixel, mean) in pixels.iter().zip(&means[d].pixels) {
                    film.pixels[pixel.y as usize * camera.width as usize + pixel.x as usize] =
                        *mean;
                }
            }
            let standard_error =
                Mean::standard_error(of_tile.iter().map(|means| &means[d]), weights.len());
            Derivative { film, standard_error }
        })
        .collect())
}

/// The weighted mean of replicates of some pixels, and what its standard error is made of.
pub(super) struct Mean {
    pub(super) pixels: Vec<[f32; 3]>,
    /// The sum of squares of the mean.
    square: f64,
    /// The sum of the squares of what each replicate takes the mean off by.
    spread: f64,
}

impl Mean {
    /// The mean of `value(r, i)` over the replicates r, for `count` pixels i.
    pub(super) fn of(
        count: usize,
        weights: &[f64],
        value: impl Fn(usize, usize) -> [f64; 3],
    ) -> Self {
        let total: f64 = weights.iter().sum();
        let (mut square, mut spread) = (0.0, 0.0);
        let mut pixel = |i: usize| {
            let weighted = || weights.iter().enumerate().map(|(r, w)| (w, value(r, i)));
            std::array::from_fn(|c| {
                let mean = weighted().map(|(w, value)| w * value[c]).sum::<f64>() / total;
                square += mean * mean;
                spread += weighted()
                    .map(|(w, value)| (w * (value[c] - mean) / total).powi(2))
                    .sum::<f64>();
                mean as f32
            })
        };
        let pixels = (0..count).map(&mut pixel).collect();
        Mean { pixels, square, spread }
    }

    /// The relative L2 of the standard error of parts of an image, for a number of replicates;
    /// `None` for one.
    pub(super) fn standard_error<'a>(
        parts: impl Iterator<Item = &'a Mean>,
        replicates: usize,
    ) -> Option<f64> {
        let n = replicates as f64;
        let (square, spread) =
            parts.fold((0.0, 0.0), |(a, b), part| (a + part.square, b + part.spread));
        let relative = if square > 0.0 { (spread * n / (n - 1.0) / square).sqrt() } else { 0.0 };
        (replicates > 1).then_some(relative)
    }
}

/// The film of camera 0 in square tiles, for what is sampled in each pixel: most edges between
/// pixels lie inside one, unless a pixel alone has as many samples as a tile should have.
pub(super) fn tiles(width: u32, height: u32, sampling: Sampling, steps: usize) -> Vec<Vec<Pixel>> {
    let points = match sampling.method {
        Method::Paper | Method::PaperAll | Method::Custom | Method::Gaussian => {
            steps.div_ceil(PUBLISHED_STEPS)
        }
        _ => 1,
    };
    let samples = sampling.spp.max(sampling.edge_samples) as usize * points;
    let side = (TILE_SAMPLES / samples).isqrt().clamp(1, LARGEST_TILE) as u32;
    let corners = (0..height)
        .step_by(side as usize)
        .flat_map(|y| (0..width).step_by(side as usize).map(move |x| (x, y)));
    corners
        .map(|(x0, y0)| {
            let rows = y0..(y0 + side).min(height);
            rows.flat_map(|y| (x0..(x0 + side).min(width)).map(move |x| Pixel { camera: 0, x, y }))
                .collect()
        })
        .collect()
}

/// The derivatives of the record's pixels in every direction.
fn forward<R: Real>(
    setup: &Setup<'_, R>,
    record: &Record<R>,
    pixels: usize,
    directions: &[Direction],
) -> Vec<Image> {
    // The rows of the Jacobian, a channel at a time; their points are the same.
    let mut rows: [Adjoints<R>; 3] = std::array::from_fn(|c| {
        let (mut row, mut ignored) =
            (Adjoints::default(), vec![R::zero(); setup.shader.parameter_count()]);
        record.vjp(setup, &vec![unit::<R>(c); pixels], Pass::PerPixel, &mut ignored, &mut row);
        row
    });
    let weighs = rows.each_ref().map(Adjoints::weighs);
    let keep: Vec<bool> = (0..rows[0].x.len()).map(|i| weighs.iter().any(|row| row[i])).collect();
    rows.iter_mut().for_each(|row| row.retain(&keep));
    let n = rows[0].x.len();
    let (mut f, mut g) = (vec![R::zero(); n], vec![R::Vec3::zero(); n]);
    directions
        .iter()
        .map(|direction| {
            let mut image = vec![[0.0; 3]; pixels];
            match *direction {
                Direction::Field(index) => {
                    let mut tangent = vec![R::zero(); setup.field.parameter_count()];
                    tangent[index] = R::one();
                    setup.field.parameter_jvp(&rows[0].x, &tangent, &mut f, &mut g);
                    for (c, row) in rows.iter().enumerate() {
                        for i in 0..n {
                            let change = row.alpha[i] * f[i] + row.c[i].dot(g[i]);
                            image[row.pixel[i] as usize][c] += change.to_double();
                        }
                    }
                }
                Direction::Along(number) => {
                    let tangent = random_unit::<R>(setup.field.parameter_count(), number);
                    rows.iter()
                        .enumerate()
                        .for_each(|(c, row)| along(setup, row, &tangent, c, &mut image));
                }
                Direction::Shader(index) => {
                    record.area.iter().for_each(|a| shader(setup, a, index, &mut image))
                }
                Direction::Background(c) => {
                    record.area.iter().for_each(|a| background(a, c, &mut image))
                }
            }
            image
        })
        .collect()
}

/// The random unit vector of a number.
pub fn random_unit<R: Real>(length: usize, number: u64) -> Vec<R> {
    let entry = |i: usize| {
        let stream = mix(mix(number, 0xa1), i as u64);
        gaussian([unit_number(mix(stream, 0)), unit_number(mix(stream, 1))])[0]
    };
    let vector: Vec<f64> = (0..length).map(entry).collect();
    let norm = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    vector.into_iter().map(|v| R::of(v / norm)).collect()
}

/// Adds the change of every pixel's channel along a tangent. By reverse mode, pixel by pixel: one
/// pass over the parameters a point, where forward mode without an implementation of its own takes
/// four.
fn along<R: Real>(
    setup: &Setup<'_, R>,
    row: &Adjoints<R>,
    tangent: &[R],
    channel: usize,
    image: &mut Image,
) {
    let mut of_pixel = vec![Adjoints::default(); image.len()];
    for i in 0..row.x.len() {
        of_pixel[row.pixel[i] as usize].push(0, row.x[i], row.alpha[i], row.c[i]);
    }
    for (value, adjoints) in image.iter_mut().zip(of_pixel) {
        let mut gradient = vec![R::zero(); tangent.len()];
        adjoints.backward(setup.field, &mut gradient);
        value[channel] +=
            gradient.iter().zip(tangent).fold(0.0, |sum, (g, t)| sum + (*g * *t).to_double());
    }
}

/// The unit vector of a channel.
fn unit<R: Real>(channel: usize) -> R::Vec3 {
    R::Vec3::from_array(std::array::from_fn(|c| if c == channel { R::one() } else { R::zero() }))
}

/// Adds the change of area samples with the background's channel.
fn background<R: Real>(area: &Area<R>, channel: usize, image: &mut Image) {
    let mut misses = vec![true; area.samples.len()];
    area.primary.hits.iter().for_each(|&i| misses[i] = false);
    for i in (0..misses.len()).filter(|&i| misses[i]) {
        image[area.pixel[i] as usize][channel] += area.weight[i].to_double();
    }
}

/// Adds the change of area samples with the shader's parameter `index`.
fn shader<R: Real>(setup: &Setup<'_, R>, area: &Area<R>, index: usize, image: &mut Image) {
    let primary = &area.primary;
    let mut row = vec![R::zero(); setup.shader.parameter_count()];
    let mut ignored = SurfaceAdjoint::zeros(1);
    for (hit, &i) in primary.hits.iter().enumerate() {
        let (x, n, d) = ([primary.x[hit]], [primary.normal[hit]], [primary.direction[hit]]);
        let point = SurfaceBatch { x: &x, normal: &n, direction: &d };
        for (c, value) in image[area.pixel[i] as usize].iter_mut().enumerate() {
            row.fill(R::zero());
            setup.shader.vjp(&point, &[unit::<R>(c)], &mut ignored, &mut row);
            *value += (row[index] * area.weight[i]).to_double();
        }
    }
}
