//! All estimators against closed forms of a ball, and `refined` against `contour`, which shares no
//! search with it, on solids with edges, creases and hidden parts.

use std::f64::consts::TAU;
use std::path::Path;

use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{EstimatorOptions, Registry, SampleCounts};
use field::SLOPE_POINTS;
use field::{Background, BackgroundRay, RayAdjoint, UniformBackground};
use glam::DVec3;
use render::Scene;
use scene::SceneFile;
use serde_json::{Value, json};

/// Pixels along a side of the film.
const SIDE: u32 = 8;

/// The focal length, in pixels.
const FOCAL: f64 = 14.0;

/// The eye; it looks along −z.
const EYE: DVec3 = DVec3::new(0.0, 0.0, 3.5);

/// The direction of the light.
const LIGHT: DVec3 = DVec3::new(0.3, 0.5, 0.8);

/// Radiances, linear red.
const BACKGROUND: f64 = 0.05;
const AMBIENT: f64 = 0.12;
const ALBEDO: f64 = 0.8;
const LAMP: f64 = 0.9;

/// A scene with a solid under one lamp.
fn lit(sdf: &Value) -> Value {
    let middle = f64::from(SIDE) / 2.0;
    json!({
        "camera": {"width": SIDE, "height": SIDE, "focal": FOCAL, "principal": [middle, middle],
                   "eye": EYE.to_array(), "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": sdf,
        "appearance": {
            "type": "lambert", "albedo": [ALBEDO, ALBEDO, ALBEDO],
            "ambient": [AMBIENT, AMBIENT, AMBIENT],
            "lights": [{"type": "directional", "direction": LIGHT.to_array(),
                        "radiance": [LAMP, LAMP, LAMP]}]
        },
        "background": [BACKGROUND, BACKGROUND, BACKGROUND]
    })
}

/// The background of most scenes.
const UNIFORM: UniformBackground<f64> = UniformBackground(DVec3::splat(BACKGROUND));

/// A background of waves, by the direction.
struct Waves;

/// Radians per unit of the direction, along x and y.
const WAVES: [f64; 2] = [9.0, 7.0];

impl Waves {
    /// The radiance and its derivative by the direction.
    fn at(d: DVec3) -> (f64, DVec3) {
        let ([sx, cx], [sy, cy]) = (
            [(WAVES[0] * d.x).sin(), (WAVES[0] * d.x).cos()],
            [(WAVES[1] * d.y).sin(), (WAVES[1] * d.y).cos()],
        );
        let slope = DVec3::new(WAVES[0] * cx * cy, -WAVES[1] * sx * sy, 0.0);
        (0.3 + 0.25 * sx * cy, 0.25 * slope)
    }
}

impl Background<f64> for Waves {
    fn parameter_count(&self) -> usize {
        0
    }
    fn radiance(&self, rays: &[BackgroundRay<f64>], rgb: &mut [DVec3]) {
        rgb.iter_mut()
            .zip(rays)
            .for_each(|(rgb, ray)| *rgb = DVec3::splat(Self::at(ray.direction).0));
    }
    fn parameter_vjp(&self, _: &[BackgroundRay<f64>], _: &[DVec3], _: &mut [f64]) {}
    fn ray_vjp(
        &self,
        rays: &[BackgroundRay<f64>],
        adjoint: &[DVec3],
        bars: &mut [RayAdjoint<f64>],
    ) {
        for ((ray, adjoint), bar) in rays.iter().zip(adjoint).zip(bars) {
            let direction = Self::at(ray.direction).1 * adjoint.element_sum();
            *bar = RayAdjoint { origin: DVec3::ZERO, direction };
        }
    }
}

/// The red channel of a derivative image: the mean over `seeds` seeds.
fn derivative(
    (scene, background): (&Value, &dyn Background<f64>),
    wrt: &str,
    estimator: &str,
    spp: u32,
    seeds: u64,
) -> Vec<f64> {
    let file = SceneFile::from_value(Path::new("scene.json"), scene).unwrap();
    let field = file.field::<f64>().unwrap();
    let shader = file.shader::<f64>(&*field).unwrap();
    let cameras = [file.camera];
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, background);
    let scene = scene.with_slope_of_field(SLOPE_POINTS);
    let index = file.sdf.pointers().iter().position(|p| p.as_deref() == Some(wrt)).unwrap();
    let estimator =
        Registry::default().get(estimator).unwrap().estimator(&EstimatorOptions::default());
    let mut mean = vec![0.0; (SIDE * SIDE) as usize];
    for seed in 0..seeds {
        let counts = SampleCounts { spp, edge_samples: spp / 2 };
        let sampling = Sampling { counts, seed };
        let images =
            differentiate(&scene, &[Direction::Field(index)], &*estimator, sampling, &|_| {})
                .unwrap();
        for (mean, pixel) in mean.iter_mut().zip(&images[0].film.pixels) {
            *mean += f64::from(pixel[0]) / seeds as f64;
        }
    }
    mean
}

/// The integral over the film of a lit ball's radiance minus the background's, in square pixels.
///
/// The directions to the ball are a cone about its centre. In the angle θ from the axis the
/// radiance falls as a square root at the rim, so that `θ = θ_max sin(w)` is a smooth parameter.
fn ball_integral(center: DVec3, radius: f64, background: impl Fn(DVec3) -> f64) -> f64 {
    let to = center - EYE;
    let distance = to.length();
    let axis = to / distance;
    let (e, widest) = (axis.any_orthonormal_vector(), (radius / distance).asin());
    let b = axis.cross(e);
    let (rings, sectors) = (400, 400);
    let mut sum = 0.0;
    for i in 0..rings {
        let w = (f64::from(i) + 0.5) / f64::from(rings) * TAU / 4.0;
        let (theta, step) = (widest * w.sin(), widest * w.cos() * TAU / 4.0 / f64::from(rings));
        for j in 0..sectors {
            let phi = (f64::from(j) + 0.5) / f64::from(sectors) * TAU;
            let d = axis * theta.cos() + (e * phi.cos() + b * phi.sin()) * theta.sin();
            let along = to.dot(d);
            let x = d * (along - (along * along - to.dot(to) + radius * radius).sqrt()) - to;
            let cosine = (x / radius).dot(LIGHT.normalize()).max(0.0);
            let radiance = ALBEDO * (AMBIENT + LAMP * cosine);
            // A solid angle is FOCAL²/cos³ square pixels at the angle to the view.
            let area =
                FOCAL * FOCAL / (-d.z).powi(3) * theta.sin() * step * TAU / f64::from(sectors);
            sum += (radiance - background(d)) * area;
        }
    }
    sum
}

#[test]
fn estimators_agree_with_the_closed_form_of_a_lit_ball() {
    let (center, radius) = (DVec3::new(0.1, -0.05, 0.2), 0.6);
    let scene = lit(&json!({"type": "sphere", "center": center.to_array(), "radius": radius}));
    let h = 1e-4;
    let difference = |f: &dyn Fn(f64) -> f64| (f(h) - f(-h)) / (2.0 * h);
    // The published estimators have a bias from the number of points along rays, and the lamp's
    // light by motion along the view is where it shows.
    let by_radius = [
        ("refined", 256, 0.005),
        ("contour", 1024, 0.001),
        ("paper", 256, 0.02),
        ("paper-all", 256, 0.02),
        ("gaussian", 256, 0.02),
        ("was", 256, 0.04),
        ("loubet", 256, 0.18),
        ("band", 256, 0.06),
    ];
    let along = &[("refined", 256, 0.005), ("contour", 1024, 0.001), ("band", 256, 0.09)];
    let uniform = |_: DVec3| BACKGROUND;
    let waves = |d: DVec3| Waves::at(d).0;
    let bigger = |h: f64| (center, radius + h);
    let closer = |h: f64| (center + DVec3::Z * h, radius);
    let change = |ball: &dyn Fn(f64) -> (DVec3, f64), background: &dyn Fn(DVec3) -> f64| {
        difference(&|h| ball_integral(ball(h).0, ball(h).1, background))
    };
    let plain: &dyn Background<f64> = &UNIFORM;
    let cases = [
        (plain, "/sdf/radius", change(&bigger, &uniform), &by_radius[..]),
        (plain, "/sdf/center/2", change(&closer, &uniform), along),
        (&Waves, "/sdf/radius", change(&bigger, &waves), &by_radius[..]),
        (&Waves, "/sdf/center/2", change(&closer, &waves), along),
    ];
    for (background, wrt, expected, estimators) in cases {
        for &(estimator, spp, allowed) in estimators {
            let sum: f64 = derivative((&scene, background), wrt, estimator, spp, 2).iter().sum();
            let off = (sum / expected - 1.0).abs();
            println!("{wrt} {estimator}: {sum}, expected {expected}, off {off:.4}");
            assert!(off < allowed, "{wrt} {estimator}: {sum}, expected {expected}");
        }
    }
}

fn ball(center: [f64; 3], radius: f64) -> Value {
    json!({"type": "sphere", "center": center, "radius": radius})
}

#[test]
fn refined_agrees_with_contour_on_edges_creases_and_hidden_parts() {
    let cuboid =
        json!({"type": "box", "center": [0.23, 0.11, 0.26], "half_size": [0.31, 0.42, 0.47]});
    let of = |operation: &str, children: &[Value]| json!({"type": operation, "children": children});
    let trees = [
        // A face that narrows to a wedge between creases.
        (of("union", &[ball([-0.1, 0.0, 0.0], 0.6), cuboid.clone()]), "/sdf/children/0/radius"),
        // Edges in front of surfaces, close and far.
        (
            of(
                "subtraction",
                &[ball([0.0; 3], 0.75), ball([0.0; 3], 0.65), ball([0.2, 0.2, 0.7], 0.4)],
            ),
            "/sdf/children/2/radius",
        ),
        (of("intersection", &[ball([0.0; 3], 0.7), cuboid]), "/sdf/children/1/center/0"),
        (
            of("intersection", &[ball([0.3, 0.0, 0.3], 0.7), ball([-0.3, 0.1, 0.0], 0.7)]),
            "/sdf/children/0/center/2",
        ),
        // A part in front of another.
        (
            of("union", &[ball([0.1, 0.1, 0.7], 0.3), ball([-0.1, -0.1, -0.3], 0.7)]),
            "/sdf/children/0/radius",
        ),
    ];
    for (sdf, wrt) in trees {
        let scene = lit(&sdf);
        let refined = derivative((&scene, &UNIFORM), wrt, "refined", 256, 4);
        let contour = derivative((&scene, &UNIFORM), wrt, "contour", 1024, 1);
        let square = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|v| v * v).sum::<f64>();
        let difference = square(&mut refined.iter().zip(&contour).map(|(a, b)| a - b));
        let off = (difference / square(&mut contour.iter().copied())).sqrt();
        println!("{wrt} of {sdf}: {off:.4}");
        assert!(off < 0.025, "{wrt} of {sdf}: {off}");
    }
}
