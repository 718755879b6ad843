//! Images: box-filtered radiance.

use std::sync::atomic::{AtomicUsize, Ordering};

use field::{Real, Vector3};
use film::{Film, srgb_decode};
use random::Stream;
use rayon::prelude::*;

use crate::invalid::InvalidField;
use crate::sample::{Pixel, pixel_samples};
use crate::scene::Scene;

/// Samples per chunk, about: enough to fill the field's blocks of points, few enough to stay in the
/// caches and to balance threads.
const CHUNK: usize = 1024;

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Render {
    /// The mean radiance of every pixel, linear RGB.
    pub film: Film,
    /// For every pixel, row-major, the fraction of its samples that hit, 0 to 1.
    pub coverage: Vec<f32>,
    /// The unit normals n of the hits as colours: the mean of n/2 + 1/2 over the samples of every
    /// pixel, in display space. A sample that misses is black.
    pub normals: Film,
}

/// Consecutive pixels of a [`Render`]. They are black before they are rendered.
struct Part<'a> {
    radiance: &'a mut [[f32; 3]],
    coverage: &'a mut [f32],
    normals: &'a mut [[f32; 3]],
}

/// Renders the image of camera number `camera` with a box filter: the value of a pixel is the mean
/// of `spp` samples in its unit square.
///
/// The same seed gives the same bits on any number of threads.
/// `progress` gets the fraction that is done; several threads call it.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If `spp` is 0 or the scene has no camera of this number.
pub fn render<R: Real>(
    scene: &Scene<'_, R>,
    camera: usize,
    spp: u32,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Render, InvalidField> {
    let (scene, stream) = (&scene.clipped_to_solid(), Stream::of_seed(seed));
    let (width, height) = (scene.cameras[camera].width, scene.cameras[camera].height);
    let count = width as usize * height as usize;
    let made = match scene.lattice {
        None => scene.lattice_for(count as u64 * u64::from(spp)),
        Some(_) => None,
    };
    // No closest approach matters to an image.
    let scene = &scene.with_lattice(scene.lattice.or(made.as_ref()), 0.0);
    let done = AtomicUsize::new(0);
    let size = (CHUNK / spp as usize).max(1);
    let mut out = Render {
        film: Film::new(width, height),
        coverage: vec![0.0; count],
        normals: Film::new(width, height),
    };
    let parts = out.film.pixels.par_chunks_mut(size).zip(out.coverage.par_chunks_mut(size));
    let parts = parts.zip(out.normals.pixels.par_chunks_mut(size)).enumerate();
    // A program that stops a command unwinds from `progress`.
    parts.panic_fuse().try_for_each(|(chunk, ((radiance, coverage), normals))| {
        let part = Part { radiance, coverage, normals };
        render_pixels(scene, camera, chunk * size, part, spp, stream)?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress((done * size) as f64 / count as f64);
        Ok(())
    })?;
    Ok(out)
}

/// Renders pixels in row-major order. `first` is the number of the first one.
fn render_pixels<R: Real>(
    scene: &Scene<'_, R>,
    camera: usize,
    first: usize,
    part: Part<'_>,
    spp: u32,
    stream: Stream,
) -> Result<(), InvalidField> {
    let width = scene.cameras[camera].width as usize;
    let pixels = first..first + part.radiance.len();
    let pixels = pixels.map(|p| Pixel { camera, x: (p % width) as u32, y: (p / width) as u32 });
    let primary = scene.primary(&pixel_samples(pixels, &(0..spp), stream))?;
    let mean = |sum: R::Vec3| sum.to_array().map(|c| (c.to_double() / f64::from(spp)) as f32);
    for (pixel, samples) in part.radiance.iter_mut().zip(primary.samples.chunks(spp as usize)) {
        *pixel = mean(samples.iter().fold(R::Vec3::zero(), |sum, s| sum + s.radiance));
    }
    for (hit, normal) in primary.hits.iter().zip(&primary.surface.normal) {
        let pixel = hit.sample / spp as usize;
        part.coverage[pixel] += 1.0;
        let colors = part.normals[pixel].iter_mut().zip(normal.to_array());
        colors.for_each(|(sum, n)| *sum += 0.5 + 0.5 * n.to_double() as f32);
    }
    for (coverage, normal) in part.coverage.iter_mut().zip(part.normals) {
        *coverage /= spp as f32;
        *normal = normal.map(|sum| srgb_decode(sum / spp as f32));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Analytic, Camera, Formula};
    use field::{Shape, Sphere, UniformBackground};
    use glam::{DVec2, DVec3};

    #[test]
    fn normals_are_those_of_a_shader_of_normals_before_black() {
        let ball = Shape::<f64>::sphere([0.1, 0.0, 0.0], 0.5);
        let shader = |formula| Analytic::<f64> { formula, parameters: vec![0.7; 3] };
        let [white, normal] = [shader(Formula::Constant), shader(Formula::Normal)];
        let (eye, centre) = (DVec3::new(0.0, 0.5, 3.0), DVec2::splat(8.0));
        let camera =
            Camera::look_at(16, 16, DVec2::splat(12.0), centre, eye, DVec3::ZERO, DVec3::Y);
        let (cameras, bounds) = ([camera.unwrap()], Sphere { center: DVec3::ZERO, radius: 1.0 });
        let (blue, black) = (UniformBackground(DVec3::Z), UniformBackground(DVec3::ZERO));
        for spp in [1, 5] {
            let scene = Scene::new(&ball, &white, &cameras, &bounds, &blue);
            let found = render(&scene, 0, spp, 3, &|_| {}).unwrap().normals;
            let scene = Scene::new(&ball, &normal, &cameras, &bounds, &black);
            let shown = render(&scene, 0, spp, 3, &|_| {}).unwrap().film;
            assert!(shown.pixels.iter().flatten().filter(|v| **v > 0.3).count() > 30);
            for (found, shown) in found.pixels.iter().zip(&shown.pixels) {
                for (found, shown) in found.iter().zip(shown) {
                    assert!((found - srgb_decode(*shown)).abs() < 1e-6, "{found}, {shown}");
                }
            }
        }
    }
}
