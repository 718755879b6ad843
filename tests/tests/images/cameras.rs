//! Derivatives by every parameter of a camera against differences of rendered images.

use std::path::Path;

use estimate::record::{Adjoints, CameraAdjoints, Pass};
use estimate::{Batch, EstimatorOptions, Registry, SampleCounts, SilhouetteMask, Terms};
use field::{Background, BackgroundRay, RayAdjoint, UniformBackground};
use field::{PartialSum, SLOPE_POINTS};
use glam::{DQuat, DVec2, DVec3};
use random::{Name, Stream};
use render::{Camera, CameraAdjoint, Pixel, Scene, render};
use scene::SceneFile;
use serde_json::{Value, json};

/// Pixels along a side of the film.
const SIDE: u32 = 12;

/// A wall at the distance `FAR` of all eyes, with waves on it.
struct Wall;

/// Distance of the wall from the eye.
const FAR: f64 = 6.0;

/// Radians per unit of length on the wall.
const WAVES: [f64; 2] = [0.9, 1.3];

impl Wall {
    /// The radiance of a ray, and its derivative by the point on the wall.
    fn at(ray: &BackgroundRay<f64>) -> (f64, DVec3) {
        let y: DVec3 = ray.origin + ray.direction * FAR;
        let phase = WAVES[0] * y.x + WAVES[1] * y.y;
        let slope = DVec3::new(WAVES[0], WAVES[1], 0.0) * 0.3 * phase.cos();
        (0.4 + 0.3 * phase.sin(), slope)
    }
}

impl Background<f64> for Wall {
    fn parameter_count(&self) -> usize {
        0
    }
    fn radiance(&self, rays: &[BackgroundRay<f64>], rgb: &mut [DVec3]) {
        rays.iter().zip(rgb).for_each(|(ray, rgb)| *rgb = DVec3::splat(Self::at(ray).0));
    }
    fn parameter_vjp(&self, _: &[BackgroundRay<f64>], _: &[DVec3], _: &mut [f64]) {}
    fn ray_vjp(
        &self,
        rays: &[BackgroundRay<f64>],
        adjoint: &[DVec3],
        bars: &mut [RayAdjoint<f64>],
    ) {
        for ((ray, adjoint), bar) in rays.iter().zip(adjoint).zip(bars) {
            let origin = Self::at(ray).1 * adjoint.element_sum();
            *bar = RayAdjoint { origin, direction: origin * FAR };
        }
    }
}

/// A solid under a lamp beside it, seen at an angle.
fn lit(sdf: &Value) -> SceneFile {
    let scene = json!({
        "camera": {"width": SIDE, "height": SIDE, "focal": [17.0, 19.0], "principal": [5.5, 6.5],
                   "eye": [1.1, 0.7, 3.2], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": sdf,
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.12, 0.12, 0.12],
            "lights": [{"type": "point", "position": [1.0, 2.0, 3.0], "intensity": [9.0, 8.0, 7.0]}]
        },
        "background": [0.05, 0.05, 0.05]
    });
    SceneFile::from_value(Path::new("scene.json"), &scene).unwrap()
}

/// A random adjoint for each pixel.
fn adjoints() -> Vec<DVec3> {
    let stream = Stream::of_seed(5).named(Name::new("adjoints", 1 << 32));
    let of = |i: u32, c| stream.at(i.into()).at(c).unit() - 0.3;
    (0..SIDE * SIDE).map(|i| DVec3::new(of(i, 0), of(i, 1), of(i, 2))).collect()
}

/// A camera as changed by one parameter, with its name, its part of an adjoint, and a step that
/// moves the picture by some hundredths of a pixel.
type Parameter = (&'static str, fn(Camera, f64) -> Camera, fn(&CameraAdjoint) -> f64, f64);

fn turned(camera: Camera, axis: DVec3, angle: f64) -> Camera {
    let turn = DQuat::from_axis_angle(axis, angle);
    let [right, up, forward] = [camera.right, camera.up, camera.forward].map(|v| turn * v);
    Camera { right, up, forward, ..camera }
}

const PARAMETERS: [Parameter; 12] = [
    ("eye x", |c, h| Camera { eye: c.eye + DVec3::X * h, ..c }, |a| a.eye.x, 0.01),
    ("eye y", |c, h| Camera { eye: c.eye + DVec3::Y * h, ..c }, |a| a.eye.y, 0.01),
    ("eye z", |c, h| Camera { eye: c.eye + DVec3::Z * h, ..c }, |a| a.eye.z, 0.02),
    ("turn x", |c, h| turned(c, DVec3::X, h), |a| a.rotation.x, 0.003),
    ("turn y", |c, h| turned(c, DVec3::Y, h), |a| a.rotation.y, 0.003),
    ("turn z", |c, h| turned(c, DVec3::Z, h), |a| a.rotation.z, 0.01),
    ("focal x", |c, h| Camera { focal: c.focal + DVec2::X * h, ..c }, |a| a.focal.x, 0.2),
    ("focal y", |c, h| Camera { focal: c.focal + DVec2::Y * h, ..c }, |a| a.focal.y, 0.2),
    (
        "principal x",
        |c, h| Camera { principal: c.principal + DVec2::X * h, ..c },
        |a| a.principal.x,
        0.05,
    ),
    (
        "principal y",
        |c, h| Camera { principal: c.principal + DVec2::Y * h, ..c },
        |a| a.principal.y,
        0.05,
    ),
    ("k1", |c, h| Camera { radial: c.radial + DVec2::X * h, ..c }, |a| a.radial.x, 0.05),
    ("k2", |c, h| Camera { radial: c.radial + DVec2::Y * h, ..c }, |a| a.radial.y, 0.2),
];

/// Σ δ·I of the image, with `spp` samples a pixel.
fn weighted(scene: &Scene<'_, f64>, delta: &[DVec3], spp: u32) -> f64 {
    let film = render(scene, 0, spp, 3, &|_| {}).unwrap().film;
    let pixel = |(delta, pixel): (&DVec3, &[f32; 3])| delta.dot(DVec3::from(pixel.map(f64::from)));
    delta.iter().zip(&film.pixels).map(pixel).sum()
}

/// The adjoint of the camera by an estimator: the mean over `seeds` seeds.
fn adjoint(scene: &Scene<'_, f64>, delta: &[DVec3], estimator: &str, seeds: u64) -> CameraAdjoint {
    let estimator =
        Registry::default().get(estimator).unwrap().estimator(&EstimatorOptions::default());
    let pixel = |i: u32| Pixel { camera: 0, x: i % SIDE, y: i / SIDE };
    let pixels: Vec<Pixel> = (0..SIDE * SIDE).map(pixel).collect();
    let counts = SampleCounts { spp: 64, edge_samples: 32 };
    let cameras = Some(CameraAdjoints::new(vec![0; pixels.len()], 1));
    let mut out = Adjoints { cameras, ..Adjoints::default() };
    let delta: Vec<DVec3> = delta.iter().map(|delta| *delta / seeds as f64).collect();
    for seed in 0..seeds {
        let batch =
            Batch { pixels: &pixels, counts, stream: Stream::of_seed(seed), terms: Terms::All };
        let record = estimator.record(scene, &batch, &mut SilhouetteMask::default()).unwrap();
        assert!(record.has_cameras());
        record.vjp(scene, &delta, Pass::Sum, &mut PartialSum::zero(64, 0..0), &mut out);
    }
    out.cameras.unwrap().sums[0]
}

#[test]
fn derivatives_by_cameras_match_differences_of_images() {
    let ball = json!({"type": "sphere", "center": [0.1, -0.05, 0.2], "radius": 0.6});
    let behind = json!({"type": "box", "center": [-0.4, 0.2, -0.3], "half_size": [0.3, 0.42, 0.4]});
    let both = json!({"type": "union", "children": [ball, behind]});
    let plain = UniformBackground(DVec3::splat(0.05));
    let cases: [(&Value, &dyn Background<f64>); 3] =
        [(&ball, &plain), (&ball, &Wall), (&both, &Wall)];
    let delta = adjoints();
    for (number, (sdf, background)) in cases.into_iter().enumerate() {
        let file = lit(sdf);
        let field = file.field::<f64>().unwrap();
        let shader = file.shader::<f64>(&*field).unwrap();
        let camera = Camera { radial: DVec2::new(0.1, -0.2), ..file.camera };
        let seen = |camera: Camera, act: &dyn Fn(&Scene<'_, f64>) -> f64| {
            let cameras = [camera];
            let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, background);
            act(&scene.with_slope_of_field(SLOPE_POINTS))
        };
        let found = std::cell::Cell::new(CameraAdjoint::default());
        seen(camera, &|scene| {
            found.set(adjoint(scene, &delta, "refined", 16));
            0.0
        });
        let pairs = PARAMETERS.map(|(name, moved, part, h)| {
            let image = |h: f64| seen(moved(camera, h), &|scene| weighted(scene, &delta, 4096));
            (name, part(&found.get()), (image(h) - image(-h)) / (2.0 * h))
        });
        // Three coordinates of the eye, three turns, and pairs of numbers of the lens.
        for kind in [&pairs[..3], &pairs[3..6], &pairs[6..8], &pairs[8..10], &pairs[10..]] {
            let size = kind.iter().map(|(_, _, difference)| difference * difference).sum::<f64>();
            for (name, found, difference) in kind {
                println!("{number} {name}: {found:.4}, difference {difference:.4}");
                let off = (found - difference).abs() / size.sqrt();
                assert!(off < 0.03, "{number} {name}: {found}, difference {difference}");
            }
        }
    }
}
