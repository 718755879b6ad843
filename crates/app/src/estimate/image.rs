//! Derivative images: d(pixel)/d(number), forward mode.

use boundary::{Edge, Edges};
use field::{Real, Vector3};
use rayon::prelude::*;

use super::pixels::{CHUNK, check_valid, pixel_samples};
use super::{Primary, Sample, Setup};
use crate::error::InvalidField;
use crate::film::Film;
use crate::sampler::{mix, sobol};

/// What an image is differentiated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// A parameter of the field.
    Field(usize),
    /// A parameter of the shader.
    Shader(usize),
    /// A channel of the background.
    Background(usize),
}

/// How the silhouette's part of a derivative is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Not at all: what backpropagation through the hit point gives.
    Interior,
    /// As published: the warp over the points of the sphere tracer, its divergence over the pixel, the flux through the
    /// pixel's border.
    Paper,
}

/// How much is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// The silhouette estimator.
    pub estimator: Estimator,
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
    /// The estimated standard error: relative L2 over the image, from independent replicates; `None` for one sample.
    pub standard_error: Option<f64>,
}

/// Independent replicates that samples are divided over, for the standard error.
const REPLICATES: u32 = 4;

type Image = Vec<[f64; 3]>;

/// Differentiates the image of the setup's first camera in each direction.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn differentiate<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Derivative>, InvalidField> {
    let replicates = REPLICATES.min(sampling.spp);
    let shares = |total: u32, r: u32| (total / replicates + u32::from(r < total % replicates)).max(1);
    let mut runs = Vec::new();
    for r in 0..replicates {
        let part = Sampling {
            spp: shares(sampling.spp, r),
            edge_samples: shares(sampling.edge_samples, r),
            seed: mix(sampling.seed, u64::from(r)),
            ..sampling
        };
        let tell = |fraction: f64| progress((f64::from(r) + fraction) / f64::from(replicates));
        runs.push((f64::from(part.spp), replicate(setup, directions, part, &tell)?));
    }
    let camera = &setup.cameras[0];
    Ok((0..directions.len())
        .map(|d| {
            let images: Vec<(f64, &Image)> = runs.iter().map(|(weight, images)| (*weight, &images[d])).collect();
            combine(camera.width, camera.height, &images)
        })
        .collect())
}

/// The weighted mean of replicates, and the relative L2 of its standard error.
fn combine(width: u32, height: u32, images: &[(f64, &Image)]) -> Derivative {
    let total: f64 = images.iter().map(|(w, _)| w).sum();
    let mut film = Film::new(width, height);
    let (mut square, mut error) = (0.0, 0.0);
    for (p, pixel) in film.pixels.iter_mut().enumerate() {
        *pixel = std::array::from_fn(|c| {
            let mean = images.iter().map(|(w, image)| w * image[p][c]).sum::<f64>() / total;
            let spread = images.iter().map(|(w, image)| (w * (image[p][c] - mean)).powi(2)).sum::<f64>();
            square += mean * mean;
            error += spread / (total * total);
            mean as f32
        });
    }
    let n = images.len() as f64;
    let standard_error = (images.len() > 1).then(|| {
        let error = error * n / (n - 1.0);
        if square > 0.0 { (error / square).sqrt() } else { 0.0 }
    });
    Derivative { film, standard_error }
}

/// One independent estimate of all derivative images.
fn replicate<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Image>, InvalidField> {
    let camera = &setup.cameras[0];
    let pixels = camera.width as usize * camera.height as usize;
    let chunks = pixels.div_ceil(CHUNK);
    let done = std::sync::atomic::AtomicUsize::new(0);
    let area: Vec<Vec<Image>> = (0..chunks)
        .into_par_iter()
        .map(|chunk| {
            let image = area(setup, directions, sampling, chunk * CHUNK..((chunk + 1) * CHUNK).min(pixels));
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress(0.8 * done as f64 / chunks as f64);
            image
        })
        .collect::<Result<_, _>>()?;
    let mut images = vec![Image::with_capacity(pixels); directions.len()];
    for chunk in area {
        for (image, part) in images.iter_mut().zip(chunk) {
            image.extend(part);
        }
    }
    if sampling.estimator == Estimator::Paper {
        add_boundary(setup, directions, sampling, &mut images)?;
    }
    progress(1.0);
    Ok(images)
}

/// The area integral of a run of pixels, for every direction.
fn area<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    pixels: std::ops::Range<usize>,
) -> Result<Vec<Image>, InvalidField> {
    let (width, spp) = (setup.cameras[0].width as usize, sampling.spp as usize);
    let samples: Vec<Sample> = pixels
        .clone()
        .flat_map(|p| pixel_samples(0, (p % width) as u32, (p / width) as u32, sampling.spp, sampling.seed))
        .collect();
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    let shading = Shading::new(setup, &samples, &primary);
    let warped = (sampling.estimator == Estimator::Paper).then(|| setup.warp(&samples, &primary.rays, true));
    let mean = |sum: [f64; 3]| sum.map(|c| c / spp as f64);
    Ok(directions
        .iter()
        .map(|direction| {
            let mut change = shading.change(setup, &primary, *direction, samples.len());
            if let (Some(warped), Direction::Field(index)) = (&warped, direction) {
                let (velocity, divergence) = warped.forward(setup, *index, samples.len());
                for (i, change) in change.iter_mut().enumerate() {
                    let carried = setup.excess(primary.radiance[i]).to_array().map(|l| (l * divergence[i]).to_double());
                    *change = std::array::from_fn(|c| change[c] + carried[c]);
                }
                for (hit, &i) in primary.hits.iter().enumerate() {
                    let slope = |c: usize| {
                        let film = shading.film[c][hit];
                        (film[0] * velocity[i][0] + film[1] * velocity[i][1]).to_double()
                    };
                    change[i] = std::array::from_fn(|c| change[i][c] + slope(c));
                }
            }
            change
                .chunks(spp)
                .map(|c| mean(c.iter().fold([0.0; 3], |s, c| std::array::from_fn(|i| s[i] + c[i]))))
                .collect()
        })
        .collect())
}

/// The Jacobian of a batch's radiance, a channel at a time, as coefficients on f and ∇f at the hits.
struct Shading<R: Real> {
    alpha: [Vec<R>; 3],
    c: [Vec<R::Vec3>; 3],
    film: [Vec<[R; 2]>; 3],
}

impl<R: Real> Shading<R> {
    fn new(setup: &Setup<'_, R>, samples: &[Sample], primary: &Primary<R>) -> Self {
        let mut ignored = vec![R::zero(); setup.shader.parameter_count()];
        let [r, g, b] = std::array::from_fn(|c| {
            let unit: [R; 3] = std::array::from_fn(|i| if i == c { R::one() } else { R::zero() });
            let adjoint = vec![R::Vec3::from_array(unit); primary.hits.len()];
            setup.surface_vjp(samples, primary, &adjoint, &mut ignored)
        });
        Shading { alpha: [r.alpha, g.alpha, b.alpha], c: [r.c, g.c, b.c], film: [r.film, g.film, b.film] }
    }

    /// ∂L of every sample at a fixed film position.
    fn change(
        &self,
        setup: &Setup<'_, R>,
        primary: &Primary<R>,
        direction: Direction,
        samples: usize,
    ) -> Vec<[f64; 3]> {
        let mut change = vec![[0.0; 3]; samples];
        match direction {
            Direction::Background(channel) => {
                change.iter_mut().for_each(|c| c[channel] = 1.0);
                primary.hits.iter().for_each(|&i| change[i][channel] = 0.0);
            }
            Direction::Field(index) => {
                let n = primary.hits.len();
                let (mut f, mut g) = (vec![R::zero(); n], vec![R::Vec3::zero(); n]);
                let tangent = one_hot(setup.field.parameter_count(), index);
                setup.field.parameter_jvp(&primary.x, &tangent, &mut f, &mut g);
                for (hit, &i) in primary.hits.iter().enumerate() {
                    let along = |c: usize| self.alpha[c][hit] * f[hit] + self.c[c][hit].dot(g[hit]);
                    change[i] = std::array::from_fn(|c| along(c).to_double());
                }
            }
            Direction::Shader(index) => {
                for (hit, &i) in primary.hits.iter().enumerate() {
                    change[i] = std::array::from_fn(|c| shader_slope(setup, primary, hit, c, index).to_double());
                }
            }
        }
        change
    }
}

/// The change of channel `c` of one hit with the shader's parameter `index`.
fn shader_slope<R: Real>(setup: &Setup<'_, R>, primary: &Primary<R>, hit: usize, c: usize, index: usize) -> R {
    let mut row = vec![R::zero(); setup.shader.parameter_count()];
    let unit: [R; 3] = std::array::from_fn(|i| if i == c { R::one() } else { R::zero() });
    let zero = || [R::Vec3::zero()];
    let (x, n, d) = ([primary.x[hit]], [primary.normal[hit]], [primary.direction[hit]]);
    let adjoint = [R::Vec3::from_array(unit)];
    setup.shader.vjp(&x, &n, &d, &adjoint, &mut zero(), &mut zero(), &mut zero(), &mut row);
    row[index]
}

/// The unit vector of a parameter.
pub(super) fn one_hot<R: Real>(length: usize, index: usize) -> Vec<R> {
    let mut tangent = vec![R::zero(); length];
    tangent[index] = R::one();
    tangent
}

/// Adds the flux through the pixels' borders to the images.
fn add_boundary<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    images: &mut [Image],
) -> Result<(), InvalidField> {
    let camera = &setup.cameras[0];
    let edges = Edges::film(camera.width, camera.height);
    let edges = edges.as_slice();
    let fluxes: Vec<Vec<Image>> = (0..edges.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let start = chunk * CHUNK;
            boundary(setup, directions, sampling, start, &edges[start..(start + CHUNK).min(edges.len())])
        })
        .collect::<Result<_, _>>()?;
    for (chunk, fluxes) in edges.chunks(CHUNK).zip(fluxes) {
        for (image, flux) in images.iter_mut().zip(fluxes) {
            for (edge, flux) in chunk.iter().zip(flux) {
                edge.scatter(flux, image);
            }
        }
    }
    Ok(())
}

/// The samples on a run of edges, the first of which has number `first`.
pub(super) fn edge_samples(edges: &[Edge], camera: usize, first: usize, count: u32, stream: u64) -> Vec<Sample> {
    // The film's area samples use the streams of pixels; edges use their own, told apart by this constant.
    const EDGES: u64 = 0xed6e;
    let mut samples = Vec::with_capacity(edges.len() * count as usize);
    for (i, edge) in edges.iter().enumerate() {
        let stream = mix(mix(stream, EDGES), (first + i) as u64);
        samples.extend((0..count).map(|s| {
            let [along] = sobol(s, stream);
            Sample { camera, u: edge.point(along).into() }
        }));
    }
    samples
}

/// The mean of L V·n over each of a run of edges, for every direction.
fn boundary<R: Real>(
    setup: &Setup<'_, R>,
    directions: &[Direction],
    sampling: Sampling,
    first: usize,
    edges: &[Edge],
) -> Result<Vec<Image>, InvalidField> {
    let count = sampling.edge_samples as usize;
    let samples = edge_samples(edges, 0, first, sampling.edge_samples, sampling.seed);
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    let warped = setup.warp(&samples, &primary.rays, false);
    Ok(directions
        .iter()
        .map(|direction| {
            let Direction::Field(index) = direction else { return vec![[0.0; 3]; edges.len()] };
            let (velocity, _) = warped.forward(setup, *index, samples.len());
            let flux = |e: usize| {
                let span = e * count..(e + 1) * count;
                velocity[span.clone()].iter().zip(&primary.radiance[span]).fold(
                    [0.0; 3],
                    |sum, (velocity, radiance)| {
                        let crossing = velocity[edges[e].axis()];
                        let carried = setup.excess(*radiance).to_array();
                        std::array::from_fn(|c| sum[c] + (carried[c] * crossing).to_double() / count as f64)
                    },
                )
            };
            (0..edges.len()).map(flux).collect()
        })
        .collect())
}
