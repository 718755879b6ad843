//! Cameras from projection matrices and from poses in the OpenCV convention (x right, y down, z
//! forward).

use glam::{DMat3, DMat4, DVec2, DVec3};
use render::Camera;

use crate::readers::lens::Lens;
use crate::readers::result::Result;
use files::InputError;

/// Focal lengths below this fraction of the other entries of K are rounding errors: K is singular.
const LEAST_FOCAL: f64 = 1e-9;

/// The camera-to-world matrix of a camera at `eye` whose axes x right, y down, z forward are given
/// in world space.
pub(crate) fn camera_to_world(x: DVec3, y: DVec3, z: DVec3, eye: DVec3) -> DMat4 {
    DMat4::from_cols(x.extend(0.0), (-y).extend(0.0), (-z).extend(0.0), eye.extend(1.0))
}

/// A camera-to-world matrix whose camera axes are turned by half a turn about x: from OpenCV's axes
/// to those of [`Camera::from_pose`], or back.
pub(crate) fn flipped(pose: DMat4) -> DMat4 {
    DMat4::from_cols(pose.x_axis, -pose.y_axis, -pose.z_axis, pose.w_axis)
}

/// Splits a projection matrix P = K [R t] (the upper three rows of `p`) into a camera and a lens
/// that holds the skew of K. P may have any scale and sign. `None` if K is singular.
///
/// Pixel centres are at integers in P, and at half-integers in the returned camera.
///
/// With M = K R, K is upper triangular and R a rotation. The rows of M, orthonormalised from the
/// last to the first, are the rows of R: an RQ decomposition (Hartley and Zisserman, "Multiple View
/// Geometry in Computer Vision", 2nd edition, 2004, section 6.2.4).
pub(crate) fn decompose(p: DMat4, width: u32, height: u32) -> Option<(Camera, Lens)> {
    let m = DMat3::from_mat4(p);
    let rows = m.transpose();
    let (a, b, c) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let z = c.try_normalize()?;
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let scale = c.length();
    let y = b.reject_from_normalized(z).try_normalize()?;
    let x = (a.reject_from_normalized(z)).reject_from_normalized(y).try_normalize()?;
    let focal = DVec2::new(a.dot(x), b.dot(y)) / scale;
    let lens = Lens { skew: a.dot(y) / scale, ..Lens::default() };
    let principal = DVec2::new(a.dot(z), b.dot(z)) / scale + 0.5;
    let eye = -(m.inverse() * p.w_axis.truncate());
    let regular = focal.is_finite()
        && focal.min_element() > LEAST_FOCAL * (focal + principal.abs()).max_element();
    let pose = camera_to_world(x * sign, y * sign, z * sign, eye);
    let camera =
        if regular { Camera::from_pose(width, height, focal, principal, pose) } else { None };
    camera.map(|camera| (camera, lens))
}

/// The largest deviation of axes from a uniform scale and from right angles, as in
/// [`Camera::from_pose`].
const UNEVEN: f64 = 1e-3;

/// The least volume that axes span, in parts of the product of their lengths.
const LEAST_VOLUME: f64 = 1e-6;

/// The camera of a pose, and the uniform scale that was divided out of its axes: 1 if they are a
/// rotation as they are. `None` if the program that wrote it has no pose for the photograph: a
/// number is not finite, or the axes do not span space.
///
/// # Errors
/// If the axes are no rotation: `wrong` makes the error of this reason.
pub(crate) fn placed(
    [width, height]: [u32; 2],
    focal: DVec2,
    principal: DVec2,
    pose: DMat4,
    wrong: impl FnOnce(String) -> InputError,
) -> Result<Option<(Camera, f64)>> {
    let camera = |pose| Camera::from_pose(width, height, focal, principal, pose);
    if let Some(camera) = camera(pose) {
        return Ok(Some((camera, 1.0)));
    }
    if is_none(pose) {
        return Ok(None);
    }
    let lengths = lengths(pose);
    let scale = lengths.iter().sum::<f64>() / 3.0;
    let is_even = lengths.iter().all(|length| (length / scale - 1.0).abs() <= UNEVEN);
    let unscaled = DMat4::from_cols(
        pose.x_axis / scale,
        pose.y_axis / scale,
        pose.z_axis / scale,
        pose.w_axis,
    );
    let camera = camera(unscaled).filter(|_| is_even);
    camera.map(|camera| Some((camera, scale))).ok_or_else(|| wrong(pose_fault(pose)))
}

/// The lengths of the axes of a pose.
fn lengths(pose: DMat4) -> [f64; 3] {
    DMat3::from_mat4(pose).to_cols_array_2d().map(|column| DVec3::from(column).length())
}

/// Whether a pose is none: a number is not finite, or the axes do not span space.
pub(crate) fn is_none(pose: DMat4) -> bool {
    let volume = lengths(pose).iter().product::<f64>();
    let spans_space = DMat3::from_mat4(pose).determinant().abs() > LEAST_VOLUME * volume;
    !pose.is_finite() || !spans_space
}

/// Describes for a message why the upper 3 × 3 of a pose is not a rotation.
pub(crate) fn pose_fault(pose: DMat4) -> String {
    if !pose.is_finite() {
        return "a number that is not finite".to_owned();
    }
    let eye = pose.w_axis.truncate();
    let distant = eye.abs().max_element();
    if distant > Camera::MOST_DISTANT {
        return format!("a camera with the coordinate {distant:e}");
    }
    let rotation = DMat3::from_mat4(pose);
    let [x, y, z] = [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|c| c.length());
    let mirrored = if rotation.determinant() < 0.0 { "a mirrored pose, with " } else { "" };
    format!(
        "{mirrored}columns of length {x:.4}, {y:.4}, {z:.4} and determinant {:.4}",
        rotation.determinant()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn a_projection_matrix_of_any_scale_and_sign_gives_its_camera() {
        let (focal, principal) = (DVec2::new(300.0, 310.0), DVec2::new(101.5, 77.5));
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera =
            Camera::look_at(200, 150, focal, principal, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let k = DMat3::from_cols(
            DVec3::X * 300.0,
            DVec3::new(1.5, 310.0, 0.0),
            DVec3::new(101.0, 77.0, 1.0),
        );
        let r = DMat3::from_cols(camera.right, -camera.up, camera.forward).transpose();
        for scale in [2.0, -0.5] {
            let (m, t) = (k * r * scale, k * (r * -camera.eye) * scale);
            let mut p = DMat4::from_mat3(m);
            p.w_axis = t.extend(1.0);
            let (found, lens) = decompose(p, 200, 150).unwrap();
            assert_relative_eq!(lens.skew, 1.5, epsilon = 1e-9);
            assert_relative_eq!(found.focal, focal, epsilon = 1e-9);
            assert_relative_eq!(found.principal, principal, epsilon = 1e-9);
            assert_relative_eq!(found.eye, camera.eye, epsilon = 1e-9);
            assert_relative_eq!(found.forward, camera.forward, epsilon = 1e-9);
            assert_relative_eq!(found.up, camera.up, epsilon = 1e-9);
        }
    }

    #[test]
    fn poses_lose_a_uniform_scale_and_those_that_are_none_are_told_from_wrong_ones() {
        let (focal, principal) = (DVec2::splat(300.0), DVec2::new(100.0, 75.0));
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera =
            Camera::look_at(200, 150, focal, principal, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let of = |pose| {
            let error = |found| InputError::new("cameras.json", "pose", found, "a rotation");
            placed([200, 150], focal, principal, pose, error)
        };
        let with = |scale: DVec3| of(camera.pose() * DMat4::from_scale(scale));
        for scale in [1.0, 1.002, 0.33, 1e-5, 1e5] {
            let (found, divided) = with(DVec3::splat(scale)).unwrap().unwrap();
            assert_relative_eq!(divided, scale, max_relative = 1e-9);
            assert_relative_eq!(found.forward, camera.forward, epsilon = 1e-9);
            assert_eq!(found.eye, eye);
        }
        for scale in [DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0), DVec3::splat(f64::INFINITY)] {
            assert_eq!(with(scale).unwrap(), None, "{scale}");
        }
        assert_eq!(of(DMat4::NAN).unwrap(), None);
        for scale in [DVec3::new(1.0, 1.01, 1.0), DVec3::splat(-1.0), DVec3::new(2.0, 2.0, 1.0)] {
            let wrong = with(scale).unwrap_err().to_string();
            assert!(wrong.contains("determinant"), "{wrong}");
        }
    }

    #[test]
    fn singular_projection_matrices_are_refused() {
        let rank_two = DMat4::from_cols_array(&[
            1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 9.0, 0.0, 7.0, 8.0, 15.0, 0.0, 1.0, 1.0, 1.0, 1.0,
        ]);
        for singular in [DMat4::ZERO, rank_two, DMat4::NAN] {
            assert!(decompose(singular, 200, 150).is_none(), "{singular}");
        }
    }
}
