//! Derivative images: the derivative of every pixel by one number of the scene.

use std::sync::atomic::{AtomicUsize, Ordering};

use field::{PartialSum, Real, SurfaceAdjoint, SurfaceBatch, Vector3};
use film::Film;
use random::{Name, Stream, gaussian};
use rayon::prelude::*;
use render::{InvalidField, Pixel, Scene};

use crate::gradient::replicates::{Image, Mean, Sampling, lattice, tiles, with_lattice};
use crate::record::{Adjoints, Area, Pass, PixelAdjoint, Record};
use crate::{Estimator, SilhouetteMask, Terms};

const WEIGHT_DIRECTION: Name = Name::new("directions in the space of weights", 9);

/// The number that an image is differentiated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// A parameter of the field, by its index.
    Field(usize),
    /// All parameters of the field at once, along the vector [`random_unit`] of this number.
    Along(u64),
    /// A parameter of the shader, by its index.
    Shader(usize),
    /// A parameter of the background, by its index: of a uniform one 0 for red, 1 for green, 2 for
    /// blue.
    Background(usize),
}

/// A derivative image.
#[derive(Clone, Debug)]
pub struct Derivative {
    /// d(pixel)/d(number), linear RGB per unit of the number.
    pub film: Film,
    /// The estimated standard error: its L2 norm over the image, relative to that of the
    /// derivative, from independent replicates; `None` for one replicate.
    pub standard_error: Option<f64>,
}

/// Differentiates the image of the scene's first camera in each direction.
///
/// The result has one derivative image per direction, all from the same samples.
/// The same seed gives the same bits on any number of threads.
/// `progress` gets the fraction that is done; several threads call it.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the number of samples per pixel is 0, the scene has no camera, or the index of a parameter or
/// of a channel is too large.
pub fn differentiate<R: Real>(
    scene: &Scene<'_, R>,
    directions: &[Direction],
    estimator: &dyn Estimator<R>,
    sampling: Sampling,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Derivative>, InvalidField> {
    let parts = sampling.replicates(estimator.depends_on_seed());
    let camera = &scene.cameras[0];
    let tiles = tiles(camera, parts[0].counts, estimator.memory_factor());
    let terms = wanted_terms(scene, directions);
    let lattice = lattice(scene, estimator, sampling.counts);
    let scene = &with_lattice(scene, lattice.as_ref());
    let done = AtomicUsize::new(0);
    let weights: Vec<f64> = parts.iter().map(|part| f64::from(part.counts.spp)).collect();
    // The derivatives of each tile, by direction.
    let of_tile: Vec<Vec<Mean>> = tiles
        .par_iter()
        // A program that stops a command unwinds from `progress`.
        .panic_fuse()
        .map(|pixels| {
            let mut mask = SilhouetteMask::default();
            let mut images = Vec::with_capacity(parts.len());
            for part in &parts {
                let record = estimator.record(scene, &part.batch(pixels, terms), &mut mask)?;
                images.push(forward(scene, &record, pixels.len(), directions));
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(done as f64 / tiles.len() as f64);
            let mean = |d: usize| Mean::of(pixels.len(), &weights, |r, i| images[r][d][i]);
            Ok((0..directions.len()).map(mean).collect())
        })
        .collect::<Result<_, _>>()?;
    let assemble = |d: usize| {
        let film = assemble(scene, &tiles, |tile| &of_tile[tile][d].pixels);
        let parts = of_tile.iter().map(|means| &means[d]);
        Derivative { film, standard_error: Mean::standard_error(parts, weights.len()) }
    };
    Ok((0..directions.len()).map(assemble).collect())
}

/// Terms that can differ from zero: a uniform radiance changes with the field at silhouettes only.
fn wanted_terms<R: Real>(scene: &Scene<'_, R>, directions: &[Direction]) -> Terms {
    let of_field = |d: &Direction| matches!(d, Direction::Field(_) | Direction::Along(_));
    if scene.shader.is_uniform() && directions.iter().all(of_field) {
        Terms::Silhouettes
    } else {
        Terms::All
    }
}

/// The film of the first camera, from the pixels of its tiles.
fn assemble<'a, R: Real>(
    scene: &Scene<'_, R>,
    tiles: &[Vec<Pixel>],
    of_tile: impl Fn(usize) -> &'a Vec<[f32; 3]>,
) -> Film {
    let (width, height) = (scene.cameras[0].width, scene.cameras[0].height);
    let mut film = Film::new(width, height);
    for (tile, pixels) in tiles.iter().enumerate() {
        for (pixel, value) in pixels.iter().zip(of_tile(tile)) {
            film.pixels[pixel.y as usize * width as usize + pixel.x as usize] = *value;
        }
    }
    film
}

/// The Jacobian of pixel values: for each channel, coefficients at the same points.
type Jacobian<R> = [Vec<PixelAdjoint<R>>; 3];

/// The Jacobian of a record, by one reverse pass per channel, without the points whose coefficients
/// are all zero.
fn jacobian<R: Real>(scene: &Scene<'_, R>, record: &Record<R>, pixels: usize) -> Jacobian<R> {
    let rows: Jacobian<R> = std::array::from_fn(|c| {
        let mut row = Adjoints::default();
        let shader = scene.shader;
        let mut ignored = PartialSum::zero(shader.parameter_count(), shader.table());
        let delta = vec![channel::<R>(c); pixels];
        record.vjp(scene, &delta, Pass::PerPixel, &mut ignored, &mut row);
        row.points
    });
    let keep: Vec<bool> =
        (0..rows[0].len()).map(|i| rows.iter().any(|row| !row[i].point.is_zero())).collect();
    rows.map(|mut row| {
        render::retain_flagged(&mut row, &keep);
        row
    })
}

/// The derivatives of a record's pixels in every direction.
fn forward<R: Real>(
    scene: &Scene<'_, R>,
    record: &Record<R>,
    pixels: usize,
    directions: &[Direction],
) -> Vec<Image> {
    let rows = jacobian(scene, record, pixels);
    let x: Vec<R::Vec3> = rows[0].iter().map(|own| own.point.x).collect();
    let derivative = |direction: &Direction| {
        let mut image = vec![[0.0; 3]; pixels];
        match *direction {
            Direction::Field(index) => add_field_parameter(scene, &rows, &x, index, &mut image),
            Direction::Along(number) => {
                let tangent = random_unit::<R>(scene.field.parameter_count(), number);
                for (c, row) in rows.iter().enumerate() {
                    add_tangent(scene, row, &tangent, c, &mut image);
                }
            }
            // All of them together, below.
            Direction::Shader(_) => {}
            Direction::Background(index) => {
                record.area.iter().for_each(|a| add_background(scene, a, index, &mut image));
            }
        }
        image
    };
    let mut images: Vec<Image> = directions.iter().map(derivative).collect();
    record.area.iter().for_each(|a| add_shader_parameters(scene, a, directions, &mut images));
    images
}

/// A random unit vector of `length` numbers, uniform in its direction; a function of `number`.
pub fn random_unit<R: Real>(length: usize, number: u64) -> Vec<R> {
    let stream = Stream::of_seed(number).named(WEIGHT_DIRECTION);
    let entry = |i: usize| {
        let stream = stream.at(i as u64);
        gaussian([stream.at(0).unit(), stream.at(1).unit()])[0]
    };
    let vector: Vec<f64> = (0..length).map(entry).collect();
    let norm = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    vector.into_iter().map(|v| R::of(v / norm)).collect()
}

/// Adds the derivative of every pixel by the field's parameter `index`, in forward mode.
fn add_field_parameter<R: Real>(
    scene: &Scene<'_, R>,
    rows: &Jacobian<R>,
    x: &[R::Vec3],
    index: usize,
    image: &mut Image,
) {
    let (mut f, mut g) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    let mut tangent = vec![R::zero(); scene.field.parameter_count()];
    tangent[index] = R::one();
    scene.field.parameter_jvp(x, &tangent, &mut f, &mut g);
    for (c, row) in rows.iter().enumerate() {
        for (i, PixelAdjoint { pixel, point }) in row.iter().enumerate() {
            let change = point.alpha * f[i] + point.c.dot(g[i]);
            image[*pixel as usize][c] += change.to_double();
        }
    }
}

/// Adds the derivative of one channel of every pixel along a tangent.
///
/// It uses reverse mode pixel by pixel: one pass over the parameters per point. The default
/// implementation of forward mode takes four.
fn add_tangent<R: Real>(
    scene: &Scene<'_, R>,
    row: &[PixelAdjoint<R>],
    tangent: &[R],
    channel: usize,
    image: &mut Image,
) {
    let mut of_pixel = vec![Adjoints::default(); image.len()];
    row.iter().for_each(|own| of_pixel[own.pixel as usize].points.push(*own));
    for (value, adjoints) in image.iter_mut().zip(of_pixel) {
        let mut gradient = vec![R::zero(); tangent.len()];
        adjoints.backward(scene.field, &mut gradient);
        value[channel] +=
            gradient.iter().zip(tangent).fold(0.0, |sum, (g, t)| sum + (*g * *t).to_double());
    }
}

/// The unit vector of a channel.
fn channel<R: Real>(channel: usize) -> R::Vec3 {
    R::Vec3::from_array(std::array::from_fn(|c| if c == channel { R::one() } else { R::zero() }))
}

/// Adds the derivative of area samples by a parameter of the background.
fn add_background<R: Real>(scene: &Scene<'_, R>, area: &Area<R>, index: usize, image: &mut Image) {
    let mut row = vec![R::zero(); scene.background.parameter_count()];
    let samples = area.weights.iter().zip(&area.primary.samples);
    for ((in_pixel, sample), hit) in samples.zip(area.primary.hit_mask()) {
        let ray = scene.background_ray(&sample.sample);
        for c in (0..3).filter(|_| !hit) {
            row.fill(R::zero());
            scene.background.parameter_vjp(&[ray], &[channel::<R>(c)], &mut row);
            image[in_pixel.pixel as usize][c] += (row[index] * in_pixel.weight).to_double();
        }
    }
}

/// Adds the derivatives of area samples by parameters of the shader, in those of the directions
/// that are such parameters. One reverse pass per hit and channel serves all of them.
fn add_shader_parameters<R: Real>(
    scene: &Scene<'_, R>,
    area: &Area<R>,
    directions: &[Direction],
    images: &mut [Image],
) {
    if !directions.iter().any(|d| matches!(d, Direction::Shader(_))) {
        return;
    }
    let primary = &area.primary;
    let mut row = vec![R::zero(); scene.shader.parameter_count()];
    let mut ignored = SurfaceAdjoint::zeros(1);
    for (i, hit) in primary.hits.iter().enumerate() {
        let point: SurfaceBatch<'_, R> = primary.surface.batch().range(i..i + 1);
        let in_pixel = area.weights[hit.sample];
        for c in 0..3 {
            row.fill(R::zero());
            scene.shader.vjp(&point, &[channel::<R>(c)], &mut ignored, &mut row);
            for (image, direction) in images.iter_mut().zip(directions) {
                if let Direction::Shader(index) = *direction {
                    image[in_pixel.pixel as usize][c] += (row[index] * in_pixel.weight).to_double();
                }
            }
        }
    }
}
