//! Overexposed surfaces.

use glam::DVec3;
use render::Camera;

use crate::photometry::Level;

/// Linear radiances that are overexposed: near white, the largest value of a photograph with 8
/// bits. Larger ones are in photographs of a high dynamic range, which are not clipped.
const OVEREXPOSED: std::ops::Range<f32> = 0.95..1.001;

/// The cosine of the largest angle between the directions of two views that show a surface alike:
/// 40 degrees.
const NEAR: f64 = 0.766;

impl Level {
    /// Whether a photograph from about the direction of a view shows the point x overexposed. The
    /// border of such a highlight moves with the camera. `cameras` are those of the views.
    ///
    /// A gap through which a white wall is seen counts, too.
    pub fn is_overexposed(&self, cameras: &[Camera], view: usize, x: DVec3) -> bool {
        let to = |eye: DVec3| (eye - x).normalize();
        let own = to(cameras[view].eye);
        cameras.iter().zip(&self.photographs).any(|(camera, photograph)| {
            to(camera.eye).dot(own) > NEAR
                && camera.project_onto_film(x).is_some_and(|u| {
                    let (x, y) = (u.x as u32, u.y as u32);
                    let shown = photograph.image.at(x, y);
                    photograph.is_used(x, y) && shown.iter().any(|v| OVEREXPOSED.contains(v))
                })
        })
    }
}

#[cfg(test)]
mod tests {
    use dataset::View;
    use field::Sphere;
    use film::Film;
    use glam::DVec2;
    use inspect::BackgroundEstimate;

    use super::*;
    use crate::photometry::{BackgroundModel, MaskUse, pyramid};

    #[test]
    fn a_point_is_overexposed_if_a_view_from_its_direction_is() {
        // The second view is 30 degrees from the first, the third 60.
        let camera = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (focal, middle) = (DVec2::splat(8.0), DVec2::splat(4.0));
            let eye = DVec3::new(sin, 0.0, cos) * 4.0;
            Camera::look_at(8, 8, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap()
        };
        let cameras = [0.0, 30.0, 60.0].map(camera);
        let model = BackgroundModel {
            bounds: Sphere { center: DVec3::ZERO, radius: 1.0 },
            estimates: vec![
                BackgroundEstimate { confidence: 0.0, ..BackgroundEstimate::NOTHING };
                3
            ],
            picture: None,
            is_trained: true,
        };
        // One pixel of a view is white in one channel. It shows points up and left of the middle.
        let is_overexposed = |white: usize, value: f32, x: DVec3| {
            let view = |number: usize| {
                let mut image = Film::grey(8, 8, [0.5; 64]);
                if number == white {
                    image.pixels[3 * 8 + 3][1] = value;
                }
                let (name, path) = (String::new(), "0.png".into());
                View { name, path, camera: cameras[number], image, mask: None }
            };
            let views: Vec<View> = (0..3).map(view).collect();
            let level = &pyramid(&views, MaskUse::None, &model, 1)[0];
            level.is_overexposed(&cameras, 0, x)
        };
        let (own, near, far) = (0, 1, 2);
        let x = DVec3::new(-0.1, 0.1, 0.0);
        assert!(is_overexposed(own, 1.0, x) && is_overexposed(near, 1.0, x));
        assert!(!is_overexposed(far, 1.0, x));
        assert!(!is_overexposed(own, 1.0, DVec3::new(0.1, 0.1, 0.0)));
        // High dynamic range.
        assert!(!is_overexposed(own, 3.0, x));
    }
}
