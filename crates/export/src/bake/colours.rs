//! The mean radiance of points towards the cameras that see them.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use render::{InvalidField, Sample, Scene, Surface, TracedRay};

/// The colour, linear RGB, of a point that no camera sees: the grey with sRGB values of 128.
pub const GREY: Vec3 = Vec3::splat(0.215_86);

/// The ray of a camera meets the surface at the point if its hit is this close, in bounding radii:
/// more than the error of the point and of the tracer where the surface is steep to the ray.
const SAME_POINT: f64 = 0.01;

/// Points that a thread takes at once.
pub(crate) const CHUNK: usize = 2048;

/// The colours of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Baked {
    /// The mean radiance of each point, linear RGB; [`GREY`] for one that no camera sees.
    pub colors: Vec<Vec3>,
    /// The number of points that no camera sees.
    pub unseen: usize,
}

/// Computes the colour of each point: the mean of its radiance towards the cameras of `scene` that
/// see it.
///
/// `points` are in world units, `normals` are their unit normals. A camera sees a point if the
/// normal points to its side, the point is inside its image, and the first hit of the ray to the
/// point is at the point, within 1/100 of the bounding radius. `progress` gets the fraction done,
/// on any thread. The colours have the same bits on any number of threads.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn bake(
    scene: &Scene<'_, f32>,
    points: &[Vec3],
    normals: &[Vec3],
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Baked, InvalidField> {
    let seen = seen(scene, points, normals, progress)?;
    let mut colors = vec![GREY; points.len()];
    let surface = points.par_chunks(CHUNK).zip(normals.par_chunks(CHUNK));
    let surface = surface.zip(seen.par_chunks(CHUNK * words(scene)));
    surface.zip(colors.par_chunks_mut(CHUNK)).for_each(|(((points, normals), seen), colors)| {
        mean_radiance(scene, points, normals, seen, colors);
    });
    let unseen = seen.chunks(words(scene)).filter(|cameras| is_unseen(cameras)).count();
    Ok(Baked { colors, unseen })
}

/// The number of words with a bit for each camera.
pub(crate) fn words(scene: &Scene<'_, f32>) -> usize {
    scene.cameras.len().div_ceil(64).max(1)
}

/// Whether the words of a point have no camera.
pub(crate) fn is_unseen(cameras: &[u64]) -> bool {
    cameras.iter().all(|word| *word == 0)
}

/// The cameras that see each point: [`words`] words a point, with a bit for each camera.
pub(crate) fn seen(
    scene: &Scene<'_, f32>,
    points: &[Vec3],
    normals: &[Vec3],
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<u64>, InvalidField> {
    let (done, all) = (AtomicUsize::new(0), points.len());
    let mut seen = vec![0; words(scene) * all];
    let chunks = points.par_chunks(CHUNK).zip(normals.par_chunks(CHUNK));
    // A program that stops a command unwinds from `progress`.
    chunks.zip(seen.par_chunks_mut(CHUNK * words(scene))).panic_fuse().try_for_each(
        |((points, normals), seen)| {
            for camera in 0..scene.cameras.len() {
                for i in seen_by(scene, camera, points, normals)? {
                    seen[i * words(scene) + camera / 64] |= 1 << (camera % 64);
                }
            }
            let before = done.fetch_add(points.len(), Ordering::Relaxed);
            progress((before + points.len()) as f64 / all as f64);
            Ok(())
        },
    )?;
    Ok(seen)
}

/// Writes the mean radiance of some points towards the cameras of `seen`, and leaves the colours of
/// points without a camera.
pub(crate) fn mean_radiance(
    scene: &Scene<'_, f32>,
    points: &[Vec3],
    normals: &[Vec3],
    seen: &[u64],
    colors: &mut [Vec3],
) {
    let mut sums = vec![(DVec3::ZERO, 0u32); points.len()];
    let mut radiance = Vec::new();
    for (camera, view) in scene.cameras.iter().enumerate() {
        let sees = |i: &usize| seen[i * words(scene) + camera / 64] >> (camera % 64) & 1 == 1;
        let indices: Vec<usize> = (0..points.len()).filter(sees).collect();
        let mut surface = Surface::default();
        for i in &indices {
            let direction = (points[*i].as_dvec3() - view.eye).normalize().as_vec3();
            surface.push(points[*i], normals[*i], direction);
        }
        radiance.resize(indices.len(), Vec3::ZERO);
        scene.shader.radiance(&surface.batch(), &mut radiance);
        for (i, radiance) in indices.iter().zip(&radiance) {
            sums[*i] = (sums[*i].0 + radiance.as_dvec3(), sums[*i].1 + 1);
        }
    }
    for (color, (sum, count)) in colors.iter_mut().zip(&sums).filter(|(_, (_, n))| *n > 0) {
        *color = (sum / f64::from(*count)).as_vec3().clamp(Vec3::ZERO, Vec3::ONE);
    }
}

/// The points that a camera sees, in order.
fn seen_by(
    scene: &Scene<'_, f32>,
    camera: usize,
    points: &[Vec3],
    normals: &[Vec3],
) -> Result<Vec<usize>, InvalidField> {
    let view = &scene.cameras[camera];
    let away = |i: usize| points[i].as_dvec3() - view.eye;
    let (candidates, samples): (Vec<usize>, Vec<Sample>) = (0..points.len())
        .filter(|i| normals[*i].as_dvec3().dot(away(*i)) < 0.0)
        .filter_map(|i| {
            Some((i, Sample { camera, u: view.project_onto_film(points[i].as_dvec3())? }))
        })
        .unzip();
    let tolerance = SAME_POINT * scene.bounds.radius;
    let hits = scene.trace(&samples)?;
    let is_there = |(i, traced): (usize, Option<TracedRay<f32>>)| {
        let depth = f64::from(traced?.depth()?);
        ((depth - away(i).length()).abs() < tolerance).then_some(i)
    };
    Ok(candidates.into_iter().zip(hits).filter_map(is_there).collect())
}

#[cfg(test)]
mod tests {
    use field::{Csg, Field, Operation, Shape, Sphere, SurfaceAdjoint, SurfaceBatch};
    use field::{Shader, UniformBackground};
    use glam::DVec2;
    use render::Camera;

    use super::*;

    /// A radiance of (x + 1)/2, (y + 1)/2 and `(d_z + 1)/2`, where d is the view direction.
    struct Ramp;

    impl Shader<f32> for Ramp {
        fn parameter_count(&self) -> usize {
            0
        }
        fn radiance(&self, points: &SurfaceBatch<'_, f32>, rgb: &mut [Vec3]) {
            for (i, rgb) in rgb.iter_mut().enumerate() {
                let (x, d) = (points.x[i], points.direction[i]);
                *rgb = Vec3::new(x.x, x.y, d.z) * 0.5 + 0.5;
            }
        }
        fn vjp(
            &self,
            _: &SurfaceBatch<'_, f32>,
            _: &[Vec3],
            _: &mut SurfaceAdjoint<f32>,
            _: &mut [f32],
        ) {
        }
    }

    fn camera(eye: DVec3) -> Camera {
        let (focal, middle) = (DVec2::splat(64.0), DVec2::splat(32.0));
        let up = if eye.x == 0.0 && eye.y == 0.0 { DVec3::Y } else { DVec3::Z };
        Camera::look_at(64, 64, focal, middle, eye, DVec3::ZERO, up).unwrap()
    }

    fn bake_with(field: &dyn Field<f32>, cameras: &[Camera], points: &[Vec3]) -> Baked {
        let bounds = Sphere { center: DVec3::ZERO, radius: 1.5 };
        let background = UniformBackground(Vec3::ZERO);
        let scene = Scene::new(field, &Ramp, cameras, &bounds, &background);
        let (mut f, mut normals) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
        field.value_gradient(points, &mut f, &mut normals);
        assert!(f.iter().all(|f| f.abs() < 1e-5));
        bake(&scene, points, &normals, &|_| {}).unwrap()
    }

    #[test]
    fn a_colour_is_the_mean_over_the_cameras_that_see_the_point() {
        let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
        let eyes = [DVec3::new(0.0, 0.0, 4.0), DVec3::new(4.0, 0.0, 4.0)];
        let cameras = eyes.map(camera);
        let points = [Vec3::Z, Vec3::X, Vec3::NEG_Y, Vec3::NEG_Z];
        let baked = bake_with(&ball, &cameras, &points);
        assert_eq!(baked.unseen, 2);
        let toward = |i: usize, eye: DVec3| (points[i].as_dvec3() - eye).normalize().z as f32;
        let blue = 0.25 * (toward(0, eyes[0]) + toward(0, eyes[1])) + 0.5;
        assert!((baked.colors[0] - Vec3::new(0.5, 0.5, blue)).length() < 1e-5);
        let blue = 0.5 * toward(1, eyes[1]) + 0.5;
        assert!((baked.colors[1] - Vec3::new(1.0, 0.5, blue)).length() < 1e-5);
        assert_eq!(baked.colors[2..], [GREY; 2]);
    }

    #[test]
    fn a_point_behind_another_part_or_beside_the_image_is_not_seen() {
        let balls: Vec<Box<dyn Field<f32>>> = vec![
            Box::new(Shape::sphere([0.0, 0.0, -0.6], 0.5)),
            Box::new(Shape::sphere([0.0, 0.0, 0.6], 0.3)),
        ];
        let balls = Csg::new(Operation::Union, balls);
        let points = [Vec3::new(0.0, 0.0, -0.1), Vec3::new(0.0, 0.0, 0.9)];
        let above = camera(DVec3::new(0.0, 0.0, 4.0));
        assert_eq!(bake_with(&balls, &[above], &points).unseen, 1);
        let narrow = Camera { principal: DVec2::new(200.0, 32.0), ..above };
        assert_eq!(bake_with(&balls, &[narrow], &points).unseen, 2);
        assert_eq!(bake_with(&balls, &[], &points).colors, [GREY; 2]);
    }
}
