//! Data sets of a scene's images in the NeRF/Blender form, with exact poses, masks and the true mesh.

use std::path::Path;

use field::{Field, SLOPE_POINTS, Sphere, fibonacci_direction};
use glam::{DVec2, DVec3};
use serde_json::{Value, json};

use crate::SceneFile;
use dataset::HELD_OUT;
use files::{InputError, WriteError, atomic_write};
use film::write_image;
use film::{Film, srgb_decode};
use mesh::{Mesh, extract, write_mesh};
use render::{Camera, InvalidField, Scene, render};

/// Options of [`synthesise`].
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Views to fit, 1 or more. An eighth as many, rounded up, are held out in addition.
    pub views: usize,
    /// Width and height of the images in pixels.
    pub size: [u32; 2],
    /// Samples a pixel.
    pub spp: u32,
    /// Seed of the samples.
    pub seed: u64,
}

/// A data set that [`synthesise`] cannot make.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene is wrong input.
    #[error(transparent)]
    Scene(#[from] InputError),
    /// The scene's field is not finite.
    #[error(transparent)]
    Field(#[from] InvalidField),
    /// A file of the data set cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl Error {
    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            Error::Scene(input) => Some(input),
            Error::Write(error) => error.input(),
            Error::Field(_) => None,
        }
    }
}

/// Distance of the cameras from the centre, in bounding radii.
const DISTANCE: f64 = 3.5;

/// The diameter of the bounding ball's outline, as a fraction of the film's shorter side.
const FILL: f64 = 0.95;

/// If |z| of a viewing direction is larger than this, the film's top is towards x instead of z.
const POLAR: f64 = 0.999;

/// Grid cells of the true mesh along the diameter of its sphere.
const TRUTH_CELLS: usize = 256;

/// Radius of the sphere in which the true mesh is extracted, in bounding radii.
const TRUTH_MARGIN: f64 = 1.02;

/// The views of one transforms file.
struct Set {
    name: &'static str,
    views: usize,
    /// Rotation of the camera lattice about z, radians: no held-out view repeats a training view.
    azimuth: f64,
}

/// `count` cameras spread evenly around a sphere, all looking at its centre with z up.
///
/// They stand at 3.5 radii on a Fibonacci lattice, rotated about z by `azimuth` radians. The focal
/// length is such that the sphere fills 95 % of the film's shorter side.
pub fn cameras(
    center: DVec3,
    radius: f64,
    count: usize,
    [width, height]: [u32; 2],
    azimuth: f64,
) -> Vec<Camera> {
    // The tangent of half the angle that the sphere subtends.
    let tangent = 1.0 / (DISTANCE * DISTANCE - 1.0).sqrt();
    let focal = 0.5 * f64::from(width.min(height)) * FILL / tangent;
    let principal = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
    (0..count)
        .filter_map(|i| {
            let direction = fibonacci_direction(i, count, azimuth);
            let up = if direction.z.abs() > POLAR { DVec3::X } else { DVec3::Z };
            let eye = center + direction * DISTANCE * radius;
            Camera::look_at(width, height, DVec2::splat(focal), principal, eye, center, up)
        })
        .collect()
}

/// Renders a scene from all around its object and writes a NeRF/Blender data set into `folder`:
/// images, poses, masks, the scene file and the true mesh.
///
/// `source` is the scene's file. It is copied to `scene.json` if it can be read, and named in
/// errors. The scene's camera is not used. `progress` receives the fraction done, from several
/// threads.
///
/// # Errors
/// If the scene is unbounded, its size does not suit single precision, its field is not finite, or a
/// file cannot be written.
///
/// # Panics
/// If `options.views` is 0.
pub fn synthesise(
    scene: &SceneFile,
    source: &Path,
    folder: &Path,
    options: &Options,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<(), Error> {
    let field = scene.field::<f32>()?;
    let ball = bounding_ball(scene, source)?;
    let shader = scene.shader::<f32>(&*field)?;
    let background = scene.background::<f32>()?;
    let held_out = options.views.div_ceil(HELD_OUT);
    let total = (options.views + held_out) as f64;
    let sets = [
        Set { name: "train", views: options.views, azimuth: 0.0 },
        Set { name: "test", views: held_out, azimuth: 1.0 },
    ];
    let mut done = 0.0;
    for set in sets {
        set.create_folders(folder)?;
        let cameras = cameras(ball.center, ball.radius, set.views, options.size, set.azimuth);
        let ready = Scene::new(&*field, &*shader, &cameras, &scene.bounds, &*background)
            .with_slope_of_field(SLOPE_POINTS);
        let mut frames = Vec::new();
        for (i, camera) in cameras.iter().enumerate() {
            let progress = |p: f64| progress((done + p) / total);
            let image = render(&ready, i, options.spp, options.seed, &progress)?;
            let world = camera.about(-scene.origin);
            frames.push(set.write_view(folder, i, &world, &image.film, &image.coverage)?);
            done += 1.0;
        }
        set.write_transforms(folder, &cameras[0], frames)?;
    }
    copy_scene(source, folder)?;
    let mesh = extract(&*field, &ball.scaled(TRUTH_MARGIN), TRUTH_CELLS, &|_| {});
    write_mesh(&folder.join("truth.ply"), &Mesh { origin: scene.origin, ..mesh })?;
    Ok(())
}

/// The solid's bounding ball, relative to the scene's origin. Refuses a solid without one, or of a
/// size whose square single precision cannot represent.
fn bounding_ball(scene: &SceneFile, source: &Path) -> Result<Sphere<f64>, InputError> {
    let error = |found: String, expected: &str| InputError::new(source, "/sdf", found, expected);
    let Some(ball) = scene.field::<f64>()?.bounds().filter(|_| scene.clip.is_none()) else {
        return Err(error("an unbounded solid".to_owned(), "a solid that a sphere can contain"));
    };
    if ball.center.is_finite() && ((ball.radius * ball.radius) as f32).is_normal() {
        return Ok(ball);
    }
    let found = format!("a solid of radius {:e}", ball.radius);
    Err(error(found, "a size whose square fits single precision"))
}

impl Set {
    fn create_folders(&self, folder: &Path) -> Result<(), InputError> {
        for sub in [folder.join(self.name), folder.join("masks").join(self.name)] {
            std::fs::create_dir_all(&sub)
                .map_err(|e| InputError::new(&sub, "output", e, "a folder that can be written"))?;
        }
        Ok(())
    }

    /// Writes the image and the mask of view `i`; returns its frame for the transforms file.
    fn write_view(
        &self,
        folder: &Path,
        i: usize,
        camera: &Camera,
        image: &Film,
        coverage: &[f32],
    ) -> Result<Value, WriteError> {
        let name = self.name;
        let file = format!("r_{i:03}.png");
        write_image(&folder.join(name).join(&file), image)?;
        // A mask file holds coverage as display values; `write_image` encodes linear ones.
        let linear = coverage.iter().map(|c| srgb_decode(*c));
        let mask = Film::grey(image.width, image.height, linear);
        write_image(&folder.join("masks").join(name).join(&file), &mask)?;
        let rows = camera.pose().transpose().to_cols_array_2d();
        Ok(json!({"file_path": format!("./{name}/r_{i:03}"), "transform_matrix": rows}))
    }

    /// Writes `transforms_{name}.json`; all cameras have the intrinsics of `camera`.
    fn write_transforms(
        &self,
        folder: &Path,
        camera: &Camera,
        frames: Vec<Value>,
    ) -> Result<(), WriteError> {
        let (w, h) = (camera.width, camera.height);
        let angle = 2.0 * (0.5 * f64::from(w) / camera.focal.x).atan();
        let json = json!({"camera_angle_x": angle, "w": w, "h": h, "frames": frames});
        let file = folder.join(format!("transforms_{}.json", self.name));
        atomic_write(&file, |out| out.write_all(&serde_json::to_vec_pretty(&json)?))
    }
}

/// Copies the scene file, if there is one.
fn copy_scene(source: &Path, folder: &Path) -> Result<(), WriteError> {
    let text = std::fs::read(source).unwrap_or_default();
    if text.is_empty() {
        return Ok(());
    }
    atomic_write(&folder.join("scene.json"), |out| out.write_all(&text))
}
