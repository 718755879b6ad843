//! The eikonal term (|∇f| − 1)².
//!
//! Gropp, Yariv, Haim, Atzmon and Lipman, "Implicit Geometric Regularization for Learning Shapes",
//! ICML 2020.

use estimate::record::PointAdjoint;
use field::Vector3;
use glam::Vec3;
use random::{Purpose, Stream};

use crate::part::{Part, pixels_of};

/// The term is evaluated at one of this many points, with this many times its weight. At 2 and
/// 8: distance 1.04 and 1.09 (see the evidence in the module `loss::schedule`).
const EIKONAL_EVERY: usize = 4;

/// The largest distance from hits of the points near the surface, in bounding radii. At 0.03 and
/// 0.3: distance 0.97 and 1.04.
const NEAR: f32 = 0.1;

/// A point of the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearPoint {
    /// The number of its pixel in the part.
    pub(crate) pixel: usize,
    /// The point, in world units.
    pub(crate) x: Vec3,
    /// The number of pixels that it stands for.
    pub(crate) weight: f32,
}

impl Part<'_> {
    /// Adds (|∇f| − 1)² near the points `surface` and at uniform points of the bounding ball.
    ///
    /// The weights are those of the points and of half a point per pixel in the ball. The term is
    /// evaluated at one of [`EIKONAL_EVERY`] of these points.
    pub(crate) fn add_eikonal(&mut self, surface: &[NearPoint]) {
        let (points, weights) = self.eikonal_points(surface);
        let (mut f, mut g) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
        self.batch.scene.field.value_gradient(&points, &mut f, &mut g);
        self.stats.eikonal_points += points.len() as u64;
        for ((x, g), weight) in points.into_iter().zip(g).zip(weights) {
            let length = g.length();
            let residual = length - 1.0;
            self.stats.eikonal += f64::from(residual * residual);
            let c = g * (2.0 * weight * residual / length.max(f32::MIN_POSITIVE));
            self.adjoints.push(PointAdjoint { pixel: 0, x, alpha: 0.0, c });
        }
    }

    /// The points, in world units, and the weight of each.
    fn eikonal_points(&self, surface: &[NearPoint]) -> (Vec<Vec3>, Vec<f32>) {
        let ball = self.batch.scene.bounding_ball();
        let weight = self.batch.eikonal * self.share * EIKONAL_EVERY as f32;
        let (mut points, mut weights) = (Vec::new(), Vec::new());
        let stream = Stream::new(self.seed, Purpose::EikonalHits);
        let start = stream.bits() as usize % EIKONAL_EVERY;
        for (i, near) in surface.iter().enumerate().skip(start).step_by(EIKONAL_EVERY) {
            points.push(near.x + self.offset(i as u64) * (NEAR * ball.radius));
            weights.push(weight * near.weight);
        }
        let pixels = pixels_of(self.pixels);
        let free = pixels.div_ceil(2 * EIKONAL_EVERY as u64);
        let stream = Stream::new(self.seed, Purpose::EikonalPoints);
        points.extend((0..free).map(|i| ball.center + in_ball(stream.at(i)) * ball.radius));
        let of_free = self.batch.eikonal * self.share * pixels as f32 / (2.0 * free as f32);
        weights.resize(points.len(), of_free);
        (points, weights)
    }

    /// A random vector for surface point `i`, with a uniform length of at most 1.
    fn offset(&self, i: u64) -> Vec3 {
        let directions = Stream::new(self.seed, Purpose::OffsetDirections).at(i);
        let length = Stream::new(self.seed, Purpose::OffsetLengths).at(i).unit();
        let direction = in_ball(directions.at(0)) + in_ball(directions.at(1));
        direction.normalize_or_zero() * length as f32
    }
}

/// A uniform random point in the unit ball.
pub(crate) fn in_ball(stream: Stream) -> Vec3 {
    <Vec3 as Vector3<f32>>::of(stream.in_ball().into())
}
