//! The views of a run.

use dataset::{Dataset, Unread};
use files::InputError;
use render::Camera;
use serde::{Deserialize, Serialize};

/// The views of a run, by their names in the data set, and a checksum of their poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// The views to fit.
    pub train: Vec<String>,
    /// The held-out views.
    pub held_out: Vec<String>,
    /// The checksum of the poses, in this order. Runs of earlier versions have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<u32>,
}

/// Poses are rounded to this share of the bounding radius, and their directions to the same number:
/// the rounding of a file format or of a unit quaternion is far less.
const ROUNDING: f64 = 1e-6;

impl Split {
    /// The views of a data set, whose bounding sphere has this radius.
    pub(crate) fn of(dataset: &Dataset, radius: f64) -> Self {
        let [train, held_out] = [&dataset.train, &dataset.test]
            .map(|views| views.iter().map(|view| view.name.clone()).collect());
        let cameras = dataset.train.iter().chain(&dataset.test).map(|view| &view.camera);
        Split { train, held_out, poses: Some(checksum(cameras, radius)) }
    }

    /// The views of a run in its own data set.
    ///
    /// # Errors
    /// If a view is missing, or if a pose is another one: a fitted surface has the place and the
    /// scale of the poses that it was fitted to.
    pub(crate) fn choose(&self, unread: Unread, radius: f64) -> Result<Unread, InputError> {
        let unread = unread.split_by_names([&self.train, &self.held_out])?;
        if self.poses.is_some_and(|poses| poses != checksum(unread.cameras_as_read(), radius)) {
            let expected = "the poses that the run was fitted to (a new fit takes the new ones; \
                            `eval`, `mesh`, `render` and `report` with --dataset take them for \
                            this surface)";
            return Err(InputError::new(unread.path(), "poses", "others", expected));
        }
        Ok(unread)
    }
}

/// The checksum of the poses of cameras, in units of `radius`.
fn checksum<'a>(cameras: impl IntoIterator<Item = &'a Camera>, radius: f64) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    for camera in cameras {
        for vector in [camera.eye / radius, camera.right, camera.up, camera.forward] {
            for number in vector.to_array() {
                hasher.update(&((number / ROUNDING).round() as i64).to_le_bytes());
            }
        }
    }
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};

    #[test]
    fn a_moved_camera_changes_the_checksum_and_rounding_does_not() {
        let camera = Camera {
            width: 8,
            height: 6,
            focal: DVec2::splat(7.0),
            principal: DVec2::new(4.0, 3.0),
            eye: DVec3::new(0.0, 3.0, -1e3),
            right: DVec3::X,
            up: DVec3::Y,
            forward: DVec3::NEG_Z,
            radial: DVec2::ZERO,
        };
        let of = |camera: &Camera| checksum([camera], 10.0);
        let at = |eye: DVec3| of(&Camera { eye, ..camera });
        assert_eq!(at(camera.eye + DVec3::new(1e-13, -1e-14, 1e-12)), of(&camera));
        assert_ne!(at(camera.eye + 1e-4 * DVec3::X), of(&camera));
        assert_ne!(of(&Camera { forward: DVec3::new(1e-4, 0.0, -1.0), ..camera }), of(&camera));
        // The size of the photographs may be another one.
        assert_eq!(of(&Camera { width: 4, focal: DVec2::splat(3.5), ..camera }), of(&camera));
    }
}
