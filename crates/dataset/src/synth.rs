//! Posed images of a scene around its object, as a NeRF/Blender data set with exact ground truth.

use std::path::Path;

use field::Field;
use glam::{DVec2, DVec3};
use serde_json::json;

use estimate::{Setup, render};
use film::Film;
use io::InputError;
use io::{atomic_write, write_image};
use mesh::{extract, write_mesh};
use render::Camera;
use scene::Scene;

/// What to synthesise.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Views to fit; an eighth as many (at least one) are held out beside them.
    pub views: usize,
    /// Width and height of the images.
    pub size: [u32; 2],
    /// Samples a pixel.
    pub spp: u32,
    /// Seed of the samples.
    pub seed: u64,
}

/// How far cameras are from the centre, in bounding radii, and how much of the film the ball fills.
const DISTANCE: f64 = 3.5;
const FILL: f64 = 0.95;

/// Grid cells of the true mesh along the bounding ball's diameter.
const TRUTH: usize = 256;

/// Cameras spread evenly over the sphere of directions (a Fibonacci lattice), all looking at the
/// centre.
pub fn cameras(
    center: DVec3,
    radius: f64,
    count: usize,
    [width, height]: [u32; 2],
    turn: f64,
) -> Vec<Camera> {
    let tangent = 1.0 / (DISTANCE * DISTANCE - 1.0).sqrt();
    let focal = 0.5 * f64::from(width.min(height)) * FILL / tangent;
    let principal = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .filter_map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (s, c) = (golden * i as f64 + turn).sin_cos();
            let direction = DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z;
            let up = if z.abs() > 0.999 { DVec3::X } else { DVec3::Z };
            Camera::look_at(
                width,
                height,
                DVec2::splat(focal),
                principal,
                center + direction * DISTANCE * radius,
                center,
                up,
            )
        })
        .collect()
}

/// Writes images, poses, masks, the scene and the true mesh into `folder`. `progress` is told the
/// fraction done.
///
/// # Errors
/// If the scene is unbounded, or a file cannot be written.
pub fn synthesise(
    scene: &Scene,
    source: &Path,
    folder: &Path,
    options: &Options,
    progress: &(dyn Fn(f64) + Sync),
) -> anyhow::Result<()> {
    let field = scene.sdf.build::<f32>()?;
    let Some(ball) = scene.sdf.build::<f64>()?.bounds() else {
        return Err(InputError::new(
            source,
            "/sdf",
            "an unbounded solid",
            "a solid that a sphere can hold",
        )
        .into());
    };
    if !(ball.center.is_finite() && ((ball.radius * ball.radius) as f32).is_normal()) {
        let found = format!("a solid of radius {:e}", ball.radius);
        return Err(InputError::new(
            source,
            "/sdf",
            found,
            "a size that single precision can square",
        )
        .into());
    }
    let shader = scene.shader::<f32>(&*field)?;
    let held_out = options.views.div_ceil(8);
    let sets = [("train", options.views, 0.0), ("test", held_out, 1.0)];
    let total = (options.views + held_out) as f64;
    let mut done = 0.0;
    for (name, count, turn) in sets {
        for sub in [folder.join(name), folder.join("masks").join(name)] {
            std::fs::create_dir_all(&sub)
                .map_err(|e| InputError::new(&sub, "output", e, "a folder that can be written"))?;
        }
        let cameras = cameras(ball.center, ball.radius, count, options.size, turn);
        let background = DVec3::from(scene.background).as_vec3();
        let setup = Setup::new(&*field, &*shader, &cameras, &scene.bounds, background);
        let mut frames = Vec::new();
        for (i, camera) in cameras.iter().enumerate() {
            let image =
                render(&setup, i, options.spp, options.seed, &|p| progress((done + p) / total))?;
            write_image(&folder.join(name).join(format!("r_{i:03}.png")), &image.film)?;
            let pixels = image.coverage.iter().map(|c| [film::srgb_decode(*c); 3]).collect();
            write_image(
                &folder.join("masks").join(name).join(format!("r_{i:03}.png")),
                &Film { pixels, ..image.film },
            )?;
            let rows = camera.pose().transpose().to_cols_array_2d();
            frames
                .push(json!({"file_path": format!("./{name}/r_{i:03}"), "transform_matrix": rows}));
            done += 1.0;
        }
        let (c, [w, h]) = (&cameras[0], options.size);
        let angle = 2.0 * (0.5 * f64::from(w) / c.focal.x).atan();
        let json = json!({"camera_angle_x": angle, "w": w, "h": h, "frames": frames});
        let text = serde_json::to_vec_pretty(&json)?;
        atomic_write(&folder.join(format!("transforms_{name}.json")), |out| {
            Ok(out.write_all(&text)?)
        })?;
    }
    let text = std::fs::read(source).unwrap_or_default();
    if !text.is_empty() {
        atomic_write(&folder.join("scene.json"), |out| Ok(out.write_all(&text)?))?;
    }
    write_mesh(&folder.join("truth.ply"), &extract(&*field, &ball.scaled(1.02), TRUTH, &|_| {}))
}
