//! A contact sheet with images of a fitted object from all sides.

use field::Sphere;
use glam::{DMat3, DVec2, DVec3};

use crate::camera::Camera;
use crate::image::render;
use crate::invalid::InvalidField;
use crate::scene::Scene;
use film::{Film, contact_sheet, labelled};

/// The distance of the cameras from the centre of the bounding sphere, in its radii.
const DISTANCE: f64 = 4.0;

/// The diameter of the outline of the bounding sphere, as a fraction of the width of the image.
const FILL: f64 = 0.98;

/// Unit vectors have a common direction if their mean is longer than this.
const SHARED: f64 = 0.5;

/// The upward direction of a set of cameras, a unit vector.
///
/// It is the mean of the upward directions of their images, if these have a common direction, or
/// else that of their directions to the right: photographs of a turned phone lie on their side.
/// Otherwise the cameras are taken to stand on a ring, and it is the axis of the ring: the
/// direction along which the unit vectors from `center` to the cameras have the least sum of
/// squares. In the last two cases the cameras are taken to stand higher than `center` in the mean.
pub fn upwards(cameras: &[Camera], center: DVec3) -> DVec3 {
    let mean = |of: fn(&Camera) -> DVec3| {
        let mean = cameras.iter().map(of).sum::<DVec3>() / cameras.len().max(1) as f64;
        (mean.length() > SHARED).then(|| mean.normalize())
    };
    if let Some(up) = mean(|c| c.up) {
        return up;
    }
    let axis = mean(|c| c.right).unwrap_or_else(|| axis_of_ring(cameras, center));
    let height: f64 = cameras.iter().map(|c| (c.eye - center).dot(axis)).sum();
    if height < 0.0 { -axis } else { axis }
}

/// The direction along which the unit vectors from `center` to the cameras have the least sum of
/// squares.
fn axis_of_ring(cameras: &[Camera], center: DVec3) -> DVec3 {
    let mut scatter = DMat3::ZERO;
    for camera in cameras {
        let d = (camera.eye - center).normalize_or_zero();
        scatter += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    // Power iteration for the eigenvector of the least eigenvalue. All eigenvalues are between 0
    // and the trace, so it is that of the largest eigenvalue of trace · I − scatter.
    let trace = scatter.x_axis.x + scatter.y_axis.y + scatter.z_axis.z;
    let flipped = DMat3::from_diagonal(DVec3::splat(trace)) - scatter;
    let mut axis = DVec3::new(0.4, 0.8, 0.45);
    for _ in 0..200 {
        axis = (flipped * axis).normalize_or(DVec3::Z);
    }
    axis
}

/// `views` cameras of `size` × `size` pixels around the sphere `bounds`, at equal angles about the
/// unit vector `up`.
///
/// The sine of their elevation is the mean over the cameras `like`, between −0.9 and 0.9.
pub fn around(
    bounds: &Sphere<f64>,
    like: &[Camera],
    up: DVec3,
    views: usize,
    size: u32,
) -> Vec<Camera> {
    let heights = like.iter().map(|c| (c.eye - bounds.center).normalize_or_zero().dot(up));
    let height = (heights.sum::<f64>() / like.len().max(1) as f64).clamp(-0.9, 0.9);
    let across = (1.0 - height * height).sqrt();
    let (u, v) = up.any_orthonormal_pair();
    let half = 0.5 * f64::from(size);
    let focal = FILL * half * (DISTANCE * DISTANCE - 1.0).sqrt();
    (0..views)
        .filter_map(|i| {
            let (s, c) = (std::f64::consts::TAU * i as f64 / views as f64).sin_cos();
            let direction = (u * c + v * s) * across + up * height;
            let eye = bounds.center + direction * (DISTANCE * bounds.radius);
            Camera::look_at(
                size,
                size,
                DVec2::splat(focal),
                DVec2::splat(half),
                eye,
                bounds.center,
                up,
            )
        })
        .collect()
}

/// A contact sheet of a scene, with one column per camera: the image, and the normals below it.
///
/// `spp` is the number of samples per pixel. `progress` gets the fraction that is done.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If `spp` is 0.
pub fn turntable(
    scene: &Scene<'_, f32>,
    spp: u32,
    progress: &dyn Fn(f64),
) -> Result<Film, InvalidField> {
    let cameras = scene.cameras;
    let (mut images, mut normals) = (Vec::new(), Vec::new());
    for camera in 0..cameras.len() {
        let image = render(scene, camera, spp, 0, &|_| {})?;
        let degrees = 360 * camera / cameras.len();
        images.push(labelled(&image.film, &format!("{degrees} degrees")));
        normals.push(labelled(&image.normals, "normals"));
        progress((camera + 1) as f64 / cameras.len() as f64);
    }
    Ok(contact_sheet(&[images, normals]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: DVec3, up: DVec3) -> Camera {
        Camera::look_at(8, 8, DVec2::splat(8.0), DVec2::splat(4.0), eye, DVec3::ZERO, up).unwrap()
    }

    #[test]
    fn up_is_the_common_direction_of_the_images_or_the_axis_of_the_ring_of_cameras() {
        let ring = |up: fn(DVec3) -> DVec3| -> Vec<Camera> {
            let place = |i: u32| DVec3::new(f64::from(i).cos(), 0.1, f64::from(i).sin()) * 5.0;
            (0..12).map(|i| camera(place(i), up(place(i)))).collect()
        };
        assert!(upwards(&ring(|_| DVec3::Y), DVec3::ZERO).dot(DVec3::Y) > 0.99);
        // Cameras on their sides: the upward direction of the images turns with them.
        for lying in [ring(|eye| eye.cross(DVec3::Y)), ring(|eye| DVec3::Y.cross(eye))] {
            assert!(upwards(&lying, DVec3::ZERO).dot(DVec3::Y) > 0.99);
        }
        // Cameras that are turned in all ways: the axis of the ring.
        let mut turned = ring(|_| DVec3::Y);
        for (i, camera) in turned.iter_mut().enumerate() {
            let (s, c) = (1.7 * i as f64).sin_cos();
            let (up, right) = (camera.up, camera.right);
            (camera.up, camera.right) = (up * c + right * s, right * c - up * s);
        }
        assert!(upwards(&turned, DVec3::ZERO).dot(DVec3::Y) > 0.99);
    }

    #[test]
    fn cameras_stand_around_the_sphere_and_see_all_of_it() {
        let bounds = Sphere { center: DVec3::new(3.0, 1.0, -2.0), radius: 0.5 };
        let cameras =
            around(&bounds, &[camera(DVec3::new(3.0, 4.0, -2.0), DVec3::X)], DVec3::Y, 6, 32);
        assert_eq!(cameras.len(), 6);
        for c in &cameras {
            assert!(((c.eye - bounds.center).length() - 2.0).abs() < 1e-12);
            assert!(bounds.clip(c.eye, c.direction(DVec2::splat(16.0))).is_some());
            assert!(bounds.clip(c.eye, c.direction(DVec2::new(16.0, 1.0))).is_some());
            assert!(bounds.clip(c.eye, c.direction(DVec2::new(16.0, -0.5))).is_none());
        }
    }
}
