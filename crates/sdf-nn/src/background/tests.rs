//! Derivatives against differences, and closed forms of simple volumes.

use approx::assert_relative_eq;
use field::{Background, BackgroundRay, FilmPlace, RayAdjoint};
use field::{Sphere, Vector3};
use glam::{DVec2, DVec3};
use proptest::prelude::*;
use random::{Name, Stream};

use crate::background::grid::table_length;
use crate::background::path::Path;
use crate::background::quadrature::{Places, Quadrature};
use crate::background::{Extent, Volume};

/// A volume does not depend on the film.
const FILM: FilmPlace = FilmPlace { u: DVec2::ZERO, size: [1, 1] };

const SPHERE: Sphere<f64> = Sphere { center: DVec3::new(0.5, -1.0, 2.0), radius: 1.5 };

/// A volume whose features are of the size that a fit gives them.
fn volume(extent: Extent, seed: u64) -> Volume<f64> {
    let mut volume = Volume::new(extent, SPHERE, Stream::of_seed(seed));
    volume.parameters[..table_length()].iter_mut().for_each(|feature| *feature *= 100.0);
    volume
}

/// The volume in single precision.
fn rounded(double: &Volume<f64>) -> Volume<f32> {
    let parameters = double.parameters.iter().map(|p| *p as f32).collect();
    Volume { extent: double.extent, sphere: double.sphere, parameters }
}

fn radiance(volume: &Volume<f64>, ray: BackgroundRay<f64>) -> DVec3 {
    let mut rgb = [DVec3::ZERO];
    volume.radiance(&[ray], &mut rgb);
    rgb[0]
}

/// A random unit vector.
fn direction(stream: Stream) -> DVec3 {
    DVec3::from(stream.in_ball()).normalize()
}

/// A ray from a random eye outside the sphere, which meets the sphere or misses it.
fn ray(seed: u64) -> BackgroundRay<f64> {
    let stream = Stream::of_seed(seed).named(Name::other("ray"));
    let eye = direction(stream.at(0)) * (1.2 + 3.0 * stream.at(1).unit());
    let aim = DVec3::from(stream.at(2).in_ball()) * 2.0;
    let origin = SPHERE.center + eye * SPHERE.radius;
    BackgroundRay { camera: 0, film: FILM, origin, direction: (aim - eye).normalize() }
}

fn vjp(volume: &Volume<f64>, ray: BackgroundRay<f64>, delta: DVec3) -> (RayAdjoint<f64>, Vec<f64>) {
    let mut sum = vec![0.0; volume.parameters.len()];
    let mut bars = [RayAdjoint::zero()];
    volume.ray_vjp(&[ray], &[delta], &mut bars);
    volume.parameter_vjp(&[ray], &[delta], &mut sum);
    (bars[0], sum)
}

const DELTA: DVec3 = DVec3::new(0.7, -1.1, 0.4);

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_derivative_by_the_ray_matches_differences(seed in 0u64..1000) {
        for extent in [Extent::Volume, Extent::Direction] {
            let (volume, ray) = (volume(extent, 3), ray(seed));
            let (bar, _) = vjp(&volume, ray, DELTA);
            let (origin, towards): (DVec3, DVec3) = (ray.origin, ray.direction);
            let across = towards.any_orthonormal_vector();
            let aside = DVec3::new(0.3, -0.8, 0.5);
            for (turn, shift) in [(across, DVec3::ZERO), (DVec3::ZERO, aside)] {
                // Radiance is smooth inside of cells only: a difference over a border between
                // cells is off, and another step is tried.
                let error = |h: f64| {
                    let along = |h: f64| {
                        let direction = (towards + turn * h).normalize();
                        let origin = origin + shift * h;
                        radiance(&volume, BackgroundRay { camera: 0, film: FILM, origin, direction })
                    };
                    let difference = (along(h) - along(-h)) / (2.0 * h);
                    let found = bar.direction.dot(turn) + bar.origin.dot(shift);
                    let size = 1.0 + bar.direction.length() + bar.origin.length();
                    (found - difference.dot(DELTA)).abs() / size
                };
                let least = [1e-5, 1e-6, 1e-7].into_iter().map(error).fold(f64::INFINITY, f64::min);
                prop_assert!(least < 1e-5, "{extent:?}: off by {least}");
            }
        }
    }

    #[test]
    fn the_derivative_by_the_parameters_matches_differences(seed in 0u64..1000) {
        for extent in [Extent::Volume, Extent::Direction] {
            let (volume, ray) = (volume(extent, 3), ray(seed));
            let places = Stream::of_seed(seed).named(Name::other("places"));
            let mut gradient = vec![0.0; volume.parameters.len()];
            volume.jittered(places).parameter_vjp(&[ray], &[DELTA], &mut gradient);
            let stream = Stream::of_seed(seed).named(Name::other("tangent"));
            let tangent: Vec<f64> =
                (0..gradient.len()).map(|i| stream.at(i as u64).unit() - 0.5).collect();
            let along = |h: f64| {
                let moved = volume.parameters.iter().zip(&tangent).map(|(p, t)| p + h * t);
                let volume = Volume { parameters: moved.collect(), ..volume.clone() };
                let mut rgb = [DVec3::ZERO];
                volume.jittered(places).radiance(&[ray], &mut rgb);
                rgb[0].dot(DELTA)
            };
            let h = 1e-6;
            let difference = (along(h) - along(-h)) / (2.0 * h);
            let product: f64 = gradient.iter().zip(&tangent).map(|(g, t)| g * t).sum();
            prop_assert!(
                (product - difference).abs() < 1e-5 * (1.0 + product.abs()),
                "{extent:?}: {product} against {difference}"
            );
        }
    }
}

#[test]
fn random_places_are_uniform_in_their_parts() {
    let volume = volume(Extent::Volume, 6);
    let seen = |places: Places, ray| {
        let mut rgb = [DVec3::ZERO];
        Quadrature { volume: &volume, places }.radiance(&[ray], &mut rgb);
        rgb[0]
    };
    let random = |i| Places::Random(Stream::of_seed(i).named(Name::other("places")));
    for ray in (0..4).map(ray) {
        let even = (0..64).map(|i| seen(Places::At((f64::from(i) + 0.5) / 64.0), ray));
        let even = even.sum::<DVec3>() / 64.0;
        let all: Vec<DVec3> = (0..4000).map(|i| seen(random(i), ray)).collect();
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        let variance = all.iter().map(|rgb| (*rgb - mean).length_squared()).sum::<f64>() / 4e3;
        assert!(variance > 1e-8, "the places differ");
        assert!((mean - even).length() < 4.0 * (variance / 4e3).sqrt(), "{mean} and {even}");
        assert_eq!(seen(random(1), ray), seen(random(1), ray));
    }
}

/// In single precision, (15 + place)/16 is 1 for the largest place below 1.
#[test]
fn the_last_point_of_the_largest_place_is_far_away_and_its_derivatives_are_finite() {
    let volume = rounded(&volume(Extent::Volume, 3));
    let place = f64::from(1.0 - f32::EPSILON / 2.0);
    let last = Quadrature { volume: &volume, places: Places::At(place) };
    let nearly = Quadrature { volume: &volume, places: Places::At(1.0 - 1e-4) };
    for seed in 0..20 {
        let BackgroundRay { origin, direction, .. } = ray(seed);
        let (origin, direction) = (origin.as_vec3(), direction.as_vec3());
        let ray = [BackgroundRay { camera: 0, film: FILM, origin, direction }];
        let (mut rgb, mut expected) = ([glam::Vec3::ZERO], [glam::Vec3::ZERO]);
        last.radiance(&ray, &mut rgb);
        nearly.radiance(&ray, &mut expected);
        assert!((rgb[0] - expected[0]).length() < 1e-2, "{} and {}", rgb[0], expected[0]);
        let mut bar = [RayAdjoint::zero()];
        last.ray_vjp(&ray, &[DELTA.as_vec3()], &mut bar);
        assert!(bar[0].origin.is_finite() && bar[0].direction.is_finite(), "{:?}", bar[0]);
    }
}

#[test]
fn rays_on_both_sides_of_the_outline_begin_close_to_each_other() {
    let eye = 5.0;
    // The height at which a ray down along z begins. Place 0 is the start of the first part.
    let height = |aside: f64| {
        let path = Path::<f64>::new(DVec3::new(aside, 0.0, eye), DVec3::NEG_Z, 0.0);
        let first: DVec3 = path.step(0).y;
        first.z
    };
    // Inside, the end of the chord, √(1 − 0.6²) behind the middle; outside, as far before it as a
    // tangent from the nearest point is long.
    for (aside, expected) in [(0.6, -0.8), (1.0, 0.0), (1.25, 0.75), (f64::sqrt(2.0), 1.0)] {
        assert_relative_eq!(height(aside), expected, epsilon = 1e-5);
    }
    // A wide ray begins at the eye.
    assert_relative_eq!(height(9.0), eye);
}

/// The total variation of the tables, corner by corner, by a route of its own.
fn variation(parameters: &[f64]) -> f64 {
    let height = |d: f64| if d.abs() < 0.05 { d * d / 0.1 } else { d.abs() - 0.025 };
    let (mut sum, mut start) = (0.0, 0);
    for side in [17, 33, 65] {
        let feature = |x: usize, y: usize, z: usize, f| {
            parameters[start + 2 * (x + side * (y + side * z)) + f]
        };
        for i in 0..2 * side * side * side {
            let (f, x, y, z) = (i % 2, i / 2 % side, i / 2 / side % side, i / 2 / side / side);
            let here = feature(x, y, z, f);
            sum += if x + 1 < side { height(feature(x + 1, y, z, f) - here) } else { 0.0 };
            sum += if y + 1 < side { height(feature(x, y + 1, z, f) - here) } else { 0.0 };
            sum += if z + 1 < side { height(feature(x, y, z + 1, f) - here) } else { 0.0 };
        }
        start += 2 * side * side * side;
    }
    sum
}

#[test]
fn smoothing_descends_the_total_variation() {
    let before = volume(Extent::Volume, 8).parameters;
    // Differences on both sides of the edge of the quadratic part.
    let before: Vec<f64> = before.iter().map(|p| 0.05 * p).collect();
    let (step, mut after) = (1e-3, before.clone());
    Volume::smooth(&mut after, step);
    let stream = Stream::of_seed(8).named(Name::other("points"));
    let tangent: Vec<f64> = (0..before.len()).map(|i| stream.at(i as u64).unit() - 0.5).collect();
    let along = |h: f64| {
        let moved: Vec<f64> = before.iter().zip(&tangent).map(|(p, t)| p + h * t).collect();
        variation(&moved)
    };
    let slope = (along(1e-6) - along(-1e-6)) / 2e-6;
    let change: f64 = after.iter().zip(&before).zip(&tangent).map(|((a, b), t)| (a - b) * t).sum();
    assert_relative_eq!(change, -step * slope, max_relative = 1e-4);
    assert_eq!(after[table_length()..], before[table_length()..], "the network stays");
}

#[test]
fn smoothing_by_any_step_is_stable() {
    let mut parameters = volume(Extent::Volume, 9).parameters;
    let mut last = variation(&parameters);
    for _ in 0..3 {
        Volume::smooth(&mut parameters, 1e9);
        assert!(variation(&parameters) < last, "the variation falls");
        last = variation(&parameters);
    }
}

/// Sets all features to zero and the outputs to those of the biases alone.
fn uniform(density: f64, outputs: [f64; 3]) -> Volume<f64> {
    let mut volume = Volume::new(Extent::Volume, SPHERE, Stream::of_seed(0));
    let n = volume.parameters.len();
    volume.parameters.fill(0.0);
    volume.parameters[n - 4] = density.exp_m1().ln();
    volume.parameters[n - 3..].copy_from_slice(&outputs);
    volume
}

#[test]
fn a_uniform_volume_has_its_radiance_along_all_rays() {
    let square = |y: f64| (1.0 / (1.0 + (-y).exp())).powi(2);
    let expected = DVec3::new(square(-1.0), square(0.0), square(2.0));
    for density in [0.01, 1.0, 30.0] {
        for seed in 0..20 {
            let found = radiance(&uniform(density, [-1.0, 0.0, 2.0]), ray(seed));
            assert_relative_eq!(found, expected, epsilon = 1e-3);
        }
    }
}

#[test]
fn the_inside_of_the_sphere_has_no_part() {
    let mut volume = uniform(1e-9, [0.0; 3]);
    // Every feature inside of the unit ball differs; no ray may see it.
    let plain = volume.clone();
    let cells = 16;
    for (z, y, x) in
        (0..17).flat_map(|z| (0..17).flat_map(move |y| (0..17).map(move |x| (z, y, x))))
    {
        let at = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * (4.0 / 16.0) - 2.0;
        // Corners whose cells lie inside of the ball.
        if at.length() + 0.25 * 3f64.sqrt() < 1.0 {
            let entry = ((z * (cells + 1) + y) * (cells + 1) + x) as usize;
            volume.parameters[2 * entry] = 1e3;
        }
    }
    assert_ne!(plain, volume);
    for seed in 0..50 {
        let ray = ray(seed);
        assert_eq!(radiance(&volume, ray), radiance(&plain, ray));
    }
}

#[test]
fn a_direction_is_seen_alike_from_everywhere() {
    let volume = volume(Extent::Direction, 5);
    let seen = |origin: DVec3| {
        radiance(&volume, BackgroundRay { camera: 0, film: FILM, origin, direction: DVec3::Y })
    };
    assert_eq!(seen(DVec3::new(9.0, 0.0, 0.0)), seen(DVec3::new(0.0, 0.0, -7.0)));
}

#[test]
fn a_file_holds_the_volume() {
    for extent in [Extent::Volume, Extent::Direction] {
        let volume = Volume::<f32>::new(extent, SPHERE, Stream::of_seed(9));
        let bytes = volume.to_safetensors().unwrap();
        assert_eq!(Volume::<f32>::from_safetensors(&bytes).unwrap(), volume);
        assert_eq!(bytes, volume.to_safetensors().unwrap());
        assert!(Volume::<f32>::from_safetensors(&bytes[..bytes.len() - 4]).is_err());
    }
}

#[test]
fn a_wrong_file_is_refused_by_name() {
    let sphere = Sphere { radius: f64::NAN, ..SPHERE };
    let bytes =
        Volume::<f32>::new(Extent::Volume, sphere, Stream::of_seed(9)).to_safetensors().unwrap();
    let error = Volume::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("\"sphere\"") && error.contains("NaN"), "{error}");
    let mut volume = Volume::<f32>::new(Extent::Volume, SPHERE, Stream::of_seed(9));
    // The product of two numbers must be finite.
    for (number, text) in [(f32::INFINITY, "inf at 5"), (3e38, "3e38 at 5")] {
        volume.parameters[5] = number;
        let bytes = volume.to_safetensors().unwrap();
        let error = Volume::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
        assert!(error.contains("\"tables\"") && error.contains(text), "{error}");
    }
}

#[test]
fn single_and_double_precision_agree() {
    let double = volume(Extent::Volume, 4);
    let single = rounded(&double);
    for seed in 0..20 {
        let ray = ray(seed);
        let own = BackgroundRay {
            camera: 0,
            film: FILM,
            origin: ray.origin.as_vec3(),
            direction: ray.direction.as_vec3(),
        };
        let mut rgb = [glam::Vec3::ZERO];
        single.radiance(&[own], &mut rgb);
        assert_relative_eq!(rgb[0].to_double(), radiance(&double, ray), epsilon = 2e-3);
    }
}
