//! Derivatives against differences, and closed forms of simple volumes.

use approx::assert_relative_eq;
use field::{Sphere, Vector3};
use glam::DVec3;
use proptest::prelude::*;
use random::{Purpose, Stream};
use render::{Background, BackgroundRay};

use crate::grid::table_length;
use crate::{Extent, Volume};

const SPHERE: Sphere<f64> = Sphere { center: DVec3::new(0.5, -1.0, 2.0), radius: 1.5 };

/// A volume whose features are of the size that a fit gives them.
fn volume(extent: Extent, seed: u64) -> Volume<f64> {
    let mut volume = Volume::new(extent, SPHERE, seed);
    volume.parameters[..table_length()].iter_mut().for_each(|feature| *feature *= 100.0);
    volume
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
    let stream = Stream::new(seed, Purpose::Other(0));
    let eye = direction(stream.at(0)) * (1.2 + 3.0 * stream.at(1).unit());
    let aim = DVec3::from(stream.at(2).in_ball()) * 2.0;
    let origin = SPHERE.center + eye * SPHERE.radius;
    BackgroundRay { camera: 0, origin, direction: (aim - eye).normalize() }
}

fn vjp(volume: &Volume<f64>, ray: BackgroundRay<f64>, delta: DVec3) -> (DVec3, Vec<f64>) {
    let mut sum = vec![0.0; volume.parameters.len()];
    let mut direction = [DVec3::ZERO];
    volume.direction_vjp(&[ray], &[delta], &mut direction);
    volume.parameter_vjp(&[ray], &[delta], &mut sum);
    (direction[0], sum)
}

const DELTA: DVec3 = DVec3::new(0.7, -1.1, 0.4);

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_derivative_by_the_direction_matches_differences(seed in 0u64..1000) {
        for extent in [Extent::Volume, Extent::Direction] {
            let (volume, ray) = (volume(extent, 3), ray(seed));
            let (bar, _) = vjp(&volume, ray, DELTA);
            let (origin, towards): (DVec3, DVec3) = (ray.origin, ray.direction);
            let across = towards.any_orthonormal_vector();
            // Radiance is smooth inside of cells only: a difference over a border between cells
            // is off, and another step is tried.
            let error = |h: f64| {
                let along = |h: f64| {
                    let direction = (towards + across * h).normalize();
                    radiance(&volume, BackgroundRay { camera: 0, origin, direction })
                };
                let difference = (along(h) - along(-h)) / (2.0 * h);
                (bar.dot(across) - difference.dot(DELTA)).abs() / (1.0 + bar.length())
            };
            let least = [1e-5, 1e-6, 1e-7].into_iter().map(error).fold(f64::INFINITY, f64::min);
            prop_assert!(least < 1e-5, "{extent:?}: off by {least}");
        }
    }

    #[test]
    fn the_derivative_by_the_parameters_matches_differences(seed in 0u64..1000) {
        for extent in [Extent::Volume, Extent::Direction] {
            let (volume, ray) = (volume(extent, 3), ray(seed));
            let (_, gradient) = vjp(&volume, ray, DELTA);
            let stream = Stream::new(seed, Purpose::Other(1));
            let tangent: Vec<f64> =
                (0..gradient.len()).map(|i| stream.at(i as u64).unit() - 0.5).collect();
            let along = |h: f64| {
                let moved = volume.parameters.iter().zip(&tangent).map(|(p, t)| p + h * t);
                let volume = Volume { parameters: moved.collect(), ..volume.clone() };
                radiance(&volume, ray).dot(DELTA)
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

/// Sets all features to zero and the outputs to those of the biases alone.
fn uniform(density: f64, outputs: [f64; 3]) -> Volume<f64> {
    let mut volume = Volume::new(Extent::Volume, SPHERE, 0);
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
    let seen =
        |origin: DVec3| radiance(&volume, BackgroundRay { camera: 0, origin, direction: DVec3::Y });
    assert_eq!(seen(DVec3::new(9.0, 0.0, 0.0)), seen(DVec3::new(0.0, 0.0, -7.0)));
}

#[test]
fn a_file_holds_the_volume() {
    for extent in [Extent::Volume, Extent::Direction] {
        let volume = Volume::<f32>::new(extent, SPHERE, 9);
        let bytes = volume.to_safetensors().unwrap();
        assert_eq!(Volume::<f32>::from_safetensors(&bytes).unwrap(), volume);
        assert_eq!(bytes, volume.to_safetensors().unwrap());
        assert!(Volume::<f32>::from_safetensors(&bytes[..bytes.len() - 4]).is_err());
    }
}

#[test]
fn a_wrong_file_is_refused_by_name() {
    let sphere = Sphere { radius: f64::NAN, ..SPHERE };
    let bytes = Volume::<f32>::new(Extent::Volume, sphere, 9).to_safetensors().unwrap();
    let error = Volume::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("\"sphere\"") && error.contains("NaN"), "{error}");
    let mut volume = Volume::<f32>::new(Extent::Volume, SPHERE, 9);
    volume.parameters[5] = f32::INFINITY;
    let bytes = volume.to_safetensors().unwrap();
    let error = Volume::<f32>::from_safetensors(&bytes).unwrap_err().to_string();
    assert!(error.contains("\"tables\"") && error.contains("inf at 5"), "{error}");
}

#[test]
fn single_and_double_precision_agree() {
    let double = volume(Extent::Volume, 4);
    let single = Volume::<f32> {
        extent: double.extent,
        sphere: double.sphere,
        parameters: double.parameters.iter().map(|p| *p as f32).collect(),
    };
    for seed in 0..20 {
        let ray = ray(seed);
        let own = BackgroundRay {
            camera: 0,
            origin: ray.origin.as_vec3(),
            direction: ray.direction.as_vec3(),
        };
        let mut rgb = [glam::Vec3::ZERO];
        single.radiance(&[own], &mut rgb);
        assert_relative_eq!(rgb[0].to_double(), radiance(&double, ray), epsilon = 2e-3);
    }
}
