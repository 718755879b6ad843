//! The part of space in which a search looks for surfaces.

use field::Sphere;
use glam::Vec3;

use crate::stereo::photo::Photo;

/// Angles between the directions from the ball's centre to two cameras that can be compared, in
/// degrees: the parallax should be visible, and the surface should look the same.
const ANGLES: [f32; 2] = [3.0, 60.0];

/// The nearest distance that is tried, as a part of the distance where the ray leaves the ball.
const MIN_OF_FAR: f32 = 0.05;

/// The nearest distance that is tried, as a part of the cameras' spread, where no ball is known.
const MIN_OF_SPREAD: f32 = 0.1;

/// The largest distance that is tried at random, in parts of the nearest, where no ball is known.
const FAR: f32 = 1e3;

/// The least distance between two cameras that can be compared, as a part of the cameras' spread,
/// where no ball is known.
const LEAST_BASELINE: f32 = 0.15;

/// The part of space in which a search looks for surfaces.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Space {
    /// A ball.
    Ball(Sphere<f32>),
    /// The space in front of the cameras.
    Anywhere {
        /// The median distance of a camera from the cameras' middle.
        spread: f32,
    },
}

impl Space {
    /// The space in front of the cameras of photographs.
    pub(crate) fn of_cameras(photos: &[Photo]) -> Self {
        let count = photos.len().max(1) as f32;
        let middle = photos.iter().map(|photo| photo.eye).sum::<Vec3>() / count;
        let mut all: Vec<f32> = photos.iter().map(|photo| photo.eye.distance(middle)).collect();
        all.sort_by(f32::total_cmp);
        Space::Anywhere { spread: all.get(all.len() / 2).copied().unwrap_or(0.0) }
    }

    /// The inverse depths at which a ray leaves and enters the space; `ray` has the length 1 along
    /// the optical axis.
    pub(crate) fn inverse_depths(&self, photo: &Photo, ray: Vec3) -> Option<[f32; 2]> {
        match self {
            Space::Ball(ball) => {
                let length = ray.length();
                let (near, far) = ball.clip(photo.eye, ray / length)?;
                Some([length / far, length / near.max(MIN_OF_FAR * far)])
            }
            Space::Anywhere { spread } => {
                let high = (MIN_OF_SPREAD * spread).recip();
                high.is_finite().then_some([high / FAR, high])
            }
        }
    }

    /// The photographs that are compared with that of `own`, at most `count`, the nearest first:
    /// those without parallax and those of another side are left out.
    pub(crate) fn nearest(&self, photos: &[Photo], own: usize, count: usize) -> Vec<usize> {
        let here = &photos[own];
        let degrees = |a: Vec3, b: Vec3| a.angle_between(b).to_degrees();
        let distance = |there: &Photo| match self {
            Space::Ball(ball) => {
                let direction = |photo: &Photo| (photo.eye - ball.center).normalize_or_zero();
                let angle = degrees(direction(here), direction(there));
                (angle > ANGLES[0] && angle < ANGLES[1]).then_some(angle)
            }
            Space::Anywhere { spread } => {
                let angle = degrees(here.axis(), there.axis());
                let baseline = here.eye.distance(there.eye) / spread;
                (angle < ANGLES[1] && baseline > LEAST_BASELINE)
                    .then(|| baseline + angle.to_radians())
            }
        };
        let others = (0..photos.len()).filter(|i| *i != own);
        let mut all: Vec<(f32, usize)> =
            others.filter_map(|i| Some((distance(&photos[i])?, i))).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.truncate(count);
        all.into_iter().map(|(_, i)| i).collect()
    }
}
