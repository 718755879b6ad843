//! The consistency of photographs at a point of a surface: a patch of one, carried to others by the
//! tangent plane, with its adjoint.
//!
//! The plane n·(y − x) = 0 through a hit x maps the rays r of a camera with the eye o to another
//! camera with the rotation R and the eye o' by y − o' ∝ r + (w·r) (o − o'), with w = n/(n·(x − o)).
//! So the loss depends on the surface by the three numbers w. Goesele, Snavely, Curless, Hoppe and
//! Seitz, "Multi-View Stereo for Community Photo Collections", ICCV 2007, choose views by their
//! correlation; Darmon, Bascle, Devaux, Monasse and Aubry, "Improving Neural Implicit Surfaces
//! Geometry with Patch Warping", CVPR 2022, fit a surface by such planes.

use std::sync::Arc;

use field::Sphere;
use glam::Vec3;
use render::Camera;

use crate::stereo::depth::View;
use crate::stereo::patch::{Agreement, Patch, pattern};
use crate::stereo::photo::Photo;
use crate::stereo::space::Space;

/// The photographs that a patch is compared with.
const COMPARED: usize = 8;

/// The least cosine between the normal and the direction towards a camera that sees the point.
const LEAST_COSINE: f32 = 0.2;

/// The variance of grey values at which a patch has half of its weight: a deviation of 0.05.
const FAINT: f32 = 2.5e-3;

/// The 1 − NCC at which a photograph has a quarter of its pull: reflections and hidden points agree
/// badly on the right surface, and well on wrong ones.
const DOUBTFUL: f32 = 0.3;

/// Photographs whose patches are compared, with the others that may show the same points.
#[derive(Debug)]
pub struct Consistency {
    photos: Vec<Photo>,
    neighbours: Arc<[Vec<usize>]>,
}

/// The loss of a point of a surface, and its adjoints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointConsistency {
    /// The mean over the other photographs that show the point of d s/(d + s), with d = 1 − NCC and
    /// s = 0.3, times the weight of the patch's contrast; below 0.3.
    pub loss: f32,
    /// The adjoint of the point, per world unit.
    pub x: Vec3,
    /// The adjoint of the unit normal.
    pub normal: Vec3,
}

/// The loss of a correlation, d s/(d + s) with d = 1 − NCC and s = 0.3, and its derivative by the
/// correlation.
///
/// The form is that of Geman and `McClure`, "Statistical Methods for Tomographic Image
/// Reconstruction", Bulletin of the International Statistical Institute 1987, with d in the place
/// of a square.
fn robust(correlation: f32) -> (f32, f32) {
    let share = DOUBTFUL / (1.0 - correlation + DOUBTFUL);
    ((1.0 - correlation) * share, -share * share)
}

impl Consistency {
    /// The photographs of an object in a ball, in world units. Each is compared with those whose
    /// cameras are near by angle.
    pub fn new(views: &[View<'_>], ball: &Sphere<f64>) -> Self {
        let photos: Vec<Photo> = views.iter().map(|v| Photo::new(v.camera, v.image)).collect();
        let ball = Sphere { center: ball.center.as_vec3(), radius: ball.radius as f32 };
        let near = |own| Space::Ball(ball).nearest(&photos, own, COMPARED);
        let neighbours = (0..photos.len()).map(near).collect();
        Consistency { photos, neighbours }
    }

    /// The same photographs by other cameras, of the same films. It copies no pixels.
    ///
    /// # Panics
    /// If the number of cameras is another one.
    #[must_use]
    pub fn with_cameras(&self, cameras: &[Camera]) -> Self {
        assert_eq!(self.photos.len(), cameras.len(), "one camera for each photograph");
        let photos = self.photos.iter().zip(cameras).map(|(photo, own)| photo.with_camera(own));
        Consistency { photos: photos.collect(), neighbours: Arc::clone(&self.neighbours) }
    }

    /// The consistency at a point `x` of a surface with the unit normal `normal`, which pixel
    /// (x, y) of photograph `view` shows. `None` if the patch around the pixel leaves the film or
    /// has no pattern in two directions, or no other photograph shows it.
    ///
    /// # Panics
    /// If there is no such photograph.
    pub fn at(
        &self,
        view: usize,
        pixel: [u32; 2],
        x: Vec3,
        normal: Vec3,
    ) -> Option<PointConsistency> {
        let photo = &self.photos[view];
        let along = x - photo.eye;
        let s = normal.dot(along);
        if -s < LEAST_COSINE * along.length() {
            return None;
        }
        let [column, row] = pixel.map(|place| place as usize);
        pattern(photo, column, row).filter(|pattern| !pattern.is_ambiguous())?;
        let patch = Patch::of(photo, column, row)?;
        let w = normal / s;

        let sees = |other: &&Photo| {
            let towards = other.eye - x;
            normal.dot(towards) > LEAST_COSINE * towards.length()
        };
        let others = self.neighbours[view].iter().map(|other| &self.photos[*other]);
        let agreement = |other| patch.agreement(photo, other, w);
        let found: Vec<Agreement> = others.filter(sees).filter_map(agreement).collect();
        if found.is_empty() {
            return None;
        }

        let weight = patch.variance() / (patch.variance() + FAINT) / found.len() as f32;
        let loss: f32 = found.iter().map(|own| robust(own.correlation).0).sum();
        let slope = |own: &Agreement| own.slope * robust(own.correlation).1;
        let w_bar = found.iter().map(slope).sum::<Vec3>() * weight;
        let across = w_bar.dot(normal) / (s * s);
        Some(PointConsistency {
            loss: loss * weight,
            x: normal * -across,
            normal: w_bar / s - along * across,
        })
    }
}
