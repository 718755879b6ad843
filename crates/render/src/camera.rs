//! Cameras.

use glam::{DMat4, DVec2, DVec3};

/// A pinhole camera, with a radial distortion that a fit may find.
///
/// Film coordinates are continuous, in pixels: x right, y down.
/// Pixel (i, j) covers [i, i+1) × [j, j+1).
/// The camera looks along its −z axis, with x right and y up (the convention of OpenGL and NeRF).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The film's width in pixels.
    pub width: u32,
    /// The film's height in pixels.
    pub height: u32,
    /// Focal lengths (x, y) in pixels.
    pub focal: DVec2,
    /// The principal point in film coordinates, in pixels.
    pub principal: DVec2,
    /// The eye, in world units.
    pub eye: DVec3,
    /// The unit vector to the right of the film, in world space.
    pub right: DVec3,
    /// The unit vector to the top of the film, in world space.
    pub up: DVec3,
    /// The unit vector along the optical axis, away from the camera, in world space.
    pub forward: DVec3,
    /// The radial distortion k₁, k₂: with p = (u − principal)/focal, the ray goes through
    /// p (1 + k₁|p|² + k₂|p|⁴) at the distance 1 along the optical axis. 0 for a pinhole.
    pub radial: DVec2,
}

/// The adjoint of a camera: the derivatives of one number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraAdjoint {
    /// By the eye, per world unit.
    pub eye: DVec3,
    /// By a rotation about the eye: a vector along the axis in world space, per radian.
    pub rotation: DVec3,
    /// By the focal lengths, per pixel.
    pub focal: DVec2,
    /// By the principal point, per pixel.
    pub principal: DVec2,
    /// By the radial distortion k₁, k₂.
    pub radial: DVec2,
}

impl std::ops::AddAssign for CameraAdjoint {
    fn add_assign(&mut self, other: Self) {
        self.eye += other.eye;
        self.rotation += other.rotation;
        self.focal += other.focal;
        self.principal += other.principal;
        self.radial += other.radial;
    }
}

/// Steps of Newton's method for the projection through a distorted lens. The distortions that a fit
/// finds are small: three steps suffice.
const LENS_STEPS: usize = 8;

impl Camera {
    /// The largest coordinate of a camera's position, in world units: squares of distances should
    /// be finite in single precision.
    pub const MOST_DISTANT: f64 = 1e15;

    /// A camera from its intrinsics and a camera-to-world matrix (x right, y up, looking along −z).
    ///
    /// `focal` and `principal` are in pixels.
    ///
    /// Returns `None` unless the matrix is finite, its upper 3 × 3 block is a rotation, and no
    /// coordinate of the position is beyond [`Camera::MOST_DISTANT`].
    /// The lengths of the columns and their dot products may be off by 1e-3; the camera has an
    /// exact rotation near it.
    pub fn from_pose(
        width: u32,
        height: u32,
        focal: DVec2,
        principal: DVec2,
        pose: DMat4,
    ) -> Option<Self> {
        let eye = pose.w_axis.truncate();
        if !pose.is_finite() || eye.abs().max_element() > Self::MOST_DISTANT {
            return None;
        }
        let [x, y, z] = [pose.x_axis, pose.y_axis, pose.z_axis].map(|c| c.truncate());
        let gram =
            [x.length() - 1.0, y.length() - 1.0, z.length() - 1.0, x.dot(y), y.dot(z), z.dot(x)];
        if gram.iter().any(|g| g.abs() > 1e-3) || x.cross(y).dot(z) < 0.0 {
            return None;
        }
        let forward = -z.normalize();
        let right = x.reject_from_normalized(forward).normalize();
        let up = right.cross(forward);
        let radial = DVec2::ZERO;
        Some(Camera { width, height, focal, principal, eye, right, up, forward, radial })
    }

    /// A camera at `eye` that looks at `target`; `None` if the two coincide or `up` is parallel to
    /// the view.
    ///
    /// `focal` and `principal` are in pixels, `eye` and `target` in world units.
    pub fn look_at(
        width: u32,
        height: u32,
        focal: DVec2,
        principal: DVec2,
        eye: DVec3,
        target: DVec3,
        up: DVec3,
    ) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        let right = forward.cross(up).try_normalize().filter(|r| r.is_finite())?;
        let up = right.cross(forward);
        let radial = DVec2::ZERO;
        Some(Camera { width, height, focal, principal, eye, right, up, forward, radial })
    }

    /// The camera-to-world matrix (x right, y up, looking along −z).
    pub fn pose(&self) -> DMat4 {
        DMat4::from_cols(
            self.right.extend(0.0),
            self.up.extend(0.0),
            (-self.forward).extend(0.0),
            self.eye.extend(1.0),
        )
    }

    /// Whether another camera has the same film, focal lengths, principal point and distortion.
    pub fn has_lens_of(&self, other: &Camera) -> bool {
        let lens = |c: &Camera| (c.width, c.height, c.focal, c.principal, c.radial);
        lens(self) == lens(other)
    }

    /// The same camera in coordinates relative to `origin`, in world units.
    #[must_use]
    pub fn about(&self, origin: DVec3) -> Self {
        Camera { eye: self.eye - origin, ..*self }
    }

    /// The same camera with a film of `width` × `height` pixels, each of which covers n × n. The
    /// last ones can reach over the border.
    #[must_use]
    pub fn reduced(&self, n: u32, width: u32, height: u32) -> Self {
        let n = f64::from(n);
        Camera { width, height, focal: self.focal / n, principal: self.principal / n, ..*self }
    }

    /// The same camera with a film of `width` × `height` pixels over the same field of view.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let scale = DVec2::new(
            f64::from(width) / f64::from(self.width),
            f64::from(height) / f64::from(self.height),
        );
        Camera {
            width,
            height,
            focal: self.focal * scale,
            principal: self.principal * scale,
            ..*self
        }
    }

    /// The factor 1 + k₁ρ + k₂ρ² of the distortion at ρ = |p|², and its derivative by ρ.
    fn lens(&self, square: f64) -> (f64, f64) {
        let DVec2 { x: k1, y: k2 } = self.radial;
        (1.0 + square * (k1 + square * k2), k1 + 2.0 * square * k2)
    }

    /// The direction through the point q at the distance 1 along the optical axis.
    fn through(&self, q: DVec2) -> DVec3 {
        self.forward + self.right * q.x - self.up * q.y
    }

    /// The unit direction through film position `u`, in world space.
    pub fn direction(&self, u: DVec2) -> DVec3 {
        let p = (u - self.principal) / self.focal;
        self.through(p * self.lens(p.length_squared()).0).normalize()
    }

    /// The unit direction through film position `u`, and its derivatives by u_x and u_y, per pixel.
    pub fn direction_du(&self, u: DVec2) -> (DVec3, [DVec3; 2]) {
        let p = (u - self.principal) / self.focal;
        let (factor, slope) = self.lens(p.length_squared());
        let w = self.through(p * factor);
        let length = w.length();
        let d = w / length;
        let along = [0, 1].map(|e| {
            let q_du = (DVec2::AXES[e] * factor + p * (2.0 * slope * p[e])) / self.focal[e];
            self.right * q_du.x - self.up * q_du.y
        });
        (d, along.map(|a| a.reject_from_normalized(d) / length))
    }

    /// VJP of camera ↦ (eye, unit direction through film position `u`), for the adjoints of both.
    ///
    /// A rotation ω turns the direction by ω × d, so its adjoint is d × d̄.
    pub fn ray_vjp(&self, u: DVec2, eye: DVec3, direction: DVec3) -> CameraAdjoint {
        let p = (u - self.principal) / self.focal;
        let square = p.length_squared();
        let (factor, slope) = self.lens(square);
        let w = self.through(p * factor);
        let d = w.normalize();
        let w_bar = direction.reject_from_normalized(d) / w.length();
        let q_bar = DVec2::new(self.right.dot(w_bar), -self.up.dot(w_bar));
        let along = q_bar.dot(p);
        let p_bar = q_bar * factor + p * (2.0 * slope * along);
        CameraAdjoint {
            eye,
            rotation: d.cross(direction),
            focal: -p_bar * p / self.focal,
            principal: -p_bar / self.focal,
            radial: DVec2::new(along * square, along * square * square),
        }
    }

    /// The film position of a world point; `None` unless the point is in front of the camera.
    pub fn project(&self, x: DVec3) -> Option<DVec2> {
        let r = x - self.eye;
        let depth = r.dot(self.forward);
        (depth > 0.0).then(|| {
            let q = DVec2::new(r.dot(self.right), -r.dot(self.up)) / depth;
            self.principal + self.undistorted(q) * self.focal
        })
    }

    /// The film position of a world point; `None` unless the point is in front of the camera and
    /// its projection is on the film.
    pub fn project_onto_film(&self, x: DVec3) -> Option<DVec2> {
        let size = DVec2::new(f64::from(self.width), f64::from(self.height));
        self.project(x).filter(|u| u.cmpge(DVec2::ZERO).all() && u.cmplt(size).all())
    }

    /// The p whose distorted position is `q`; see [`Camera::radial`].
    fn undistorted(&self, q: DVec2) -> DVec2 {
        let length = q.length();
        if self.radial == DVec2::ZERO || length == 0.0 {
            return q;
        }
        let mut radius = length;
        for _ in 0..LENS_STEPS {
            let square = radius * radius;
            let (factor, slope) = self.lens(square);
            radius -= (radius * factor - length) / (factor + 2.0 * square * slope);
        }
        q * (radius / length)
    }

    /// The longer side of a pixel at unit distance along the optical axis, in world units.
    ///
    /// Times a distance, it is the width of a pixel there.
    pub fn pixel_angle(&self) -> f64 {
        1.0 / self.focal.min_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn camera() -> Camera {
        let (focal, principal) = (DVec2::new(64.0, 70.0), DVec2::new(15.0, 17.0));
        Camera::look_at(32, 30, focal, principal, DVec3::new(0.5, 1.0, 4.0), DVec3::ZERO, DVec3::Y)
            .unwrap()
    }

    fn distorted() -> Camera {
        Camera { radial: DVec2::new(-0.3, 0.2), ..camera() }
    }

    proptest! {
        #[test]
        fn projection_inverts_direction(x in 0.0..32.0f64, y in 0.0..30.0f64, t in 0.5..9.0f64) {
            let (c, u) = (camera(), DVec2::new(x, y));
            assert_relative_eq!(c.project(c.eye + t * c.direction(u)).unwrap(), u, epsilon = 1e-9);
            let again =
                Camera::from_pose(c.width, c.height, c.focal, c.principal, c.pose()).unwrap();
            assert_relative_eq!(again.direction(u), c.direction(u), epsilon = 1e-12);
        }

        #[test]
        fn direction_derivatives_match_differences(x in 0.0..32.0f64, y in 0.0..30.0f64) {
            let (c, u, h) = (distorted(), DVec2::new(x, y), 1e-5);
            let (_, du) = c.direction_du(u);
            for (e, du) in [DVec2::X, DVec2::Y].into_iter().zip(du) {
                let difference = (c.direction(u + h * e) - c.direction(u - h * e)) / (2.0 * h);
                assert_relative_eq!(du, difference, epsilon = 1e-8);
            }
            let again = c.project(c.eye + 3.0 * c.direction(u)).unwrap();
            assert_relative_eq!(again, u, epsilon = 1e-9);
        }

        #[test]
        fn the_adjoint_of_a_ray_matches_differences(x in 0.0..32.0f64, y in 0.0..30.0f64) {
            let (c, u, h) = (distorted(), DVec2::new(x, y), 1e-5);
            let (eye, direction) = (DVec3::new(0.5, -2.0, 1.0), DVec3::new(1.5, 0.25, -0.75));
            let seen = |c: Camera| eye.dot(c.eye) + direction.dot(c.direction(u));
            let found = c.ray_vjp(u, eye, direction);
            let check = |found: f64, moved: &dyn Fn(f64) -> Camera| {
                let difference = (seen(moved(h)) - seen(moved(-h))) / (2.0 * h);
                assert_relative_eq!(found, difference, epsilon = 1e-8);
            };
            for axis in 0..3 {
                let unit = DVec3::AXES[axis];
                check(found.eye[axis], &|h| Camera { eye: c.eye + unit * h, ..c });
                check(found.rotation[axis], &|h| {
                    let turn = glam::DQuat::from_axis_angle(unit, h);
                    let [right, up, forward] = [c.right, c.up, c.forward].map(|v| turn * v);
                    Camera { right, up, forward, ..c }
                });
            }
            for axis in 0..2 {
                let unit = DVec2::AXES[axis];
                check(found.focal[axis], &|h| Camera { focal: c.focal + unit * h, ..c });
                check(found.principal[axis], &|h| Camera {
                    principal: c.principal + unit * h,
                    ..c
                });
                check(found.radial[axis], &|h| Camera { radial: c.radial + unit * h, ..c });
            }
        }
    }

    #[test]
    fn y_points_down_on_the_film() {
        let c = camera();
        let above = c.project(c.eye + c.forward + 0.1 * c.up).unwrap();
        assert!(above.y < c.principal.y);
    }

    #[test]
    fn mirrored_scaled_and_nan_poses_give_no_camera() {
        let c = camera();
        let mirrored = c.pose() * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let nan = DMat4::from_cols_array(&[f64::NAN; 16]);
        for pose in [mirrored, nan, c.pose() * 2.0] {
            assert_eq!(Camera::from_pose(32, 30, c.focal, c.principal, pose), None);
        }
    }
}
