//! The eikonal term (|∇f| − 1)².
//!
//! Gropp, Yariv, Haim, Atzmon and Lipman, "Implicit Geometric Regularization for Learning Shapes",
//! ICML 2020.

use field::Vector3;
use glam::Vec3;
use random::{Name, Stream};

use crate::drawn::{Drawn, NearPoint, one_of, pixels_of};
use crate::reversed::Reversed;

/// The term is evaluated at one of this many points, with this many times its weight. At 2 and
/// 8: distance 1.04 and 1.09 (see the evidence in the module `loss::schedule`).
const EVERY: usize = 4;

/// The largest distance from hits of the points near the surface, in bounding radii. At 0.03 and
/// 0.3: distance 0.97 and 1.04.
const NEAR: f32 = 0.1;

const EIKONAL_HITS: Name = Name::new("hits of the eikonal term", 17);
const EIKONAL_POINTS: Name = Name::new("points of the eikonal term in the ball", 18);
const OFFSET_DIRECTIONS: Name = Name::new("directions from hits to points of the eikonal term", 19);
const OFFSET_LENGTHS: Name = Name::new("distances from hits to points of the eikonal term", 20);

/// Adds (|∇f| − 1)² near the points `surface` and at uniform points of the bounding ball.
///
/// The weights are the weights of the points, and of half a point per pixel in the ball. The term
/// is evaluated at one of [`EVERY`] of these points.
pub(crate) fn eikonal(drawn: &Drawn<'_>, surface: &[NearPoint], weight: f32, out: &mut Reversed) {
    let (points, weights) = eikonal_points(drawn, surface, weight);
    let (mut f, mut g) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
    drawn.objective.scene.field.value_gradient(&points, &mut f, &mut g);

    out.stats.eikonal_points += points.len() as u64;
    for ((x, g), weight) in points.into_iter().zip(g).zip(weights) {
        let length = g.length();
        let residual = length - 1.0;
        out.stats.eikonal += f64::from(residual * residual);
        out.push_gradient(x, g * (2.0 * weight * residual / length.max(f32::MIN_POSITIVE)));
    }
}

/// The points of the term, in world units, and the weight of each.
fn eikonal_points(drawn: &Drawn<'_>, surface: &[NearPoint], weight: f32) -> (Vec<Vec3>, Vec<f32>) {
    let ball = drawn.objective.scene.bounding_ball();
    let (mut points, mut weights) = (Vec::new(), Vec::new());

    let of_hit = weight * drawn.objective.pixel_weight() * EVERY as f32;
    let stream = drawn.stream.named(EIKONAL_HITS);
    for (i, near) in one_of(EVERY, surface.iter().enumerate(), stream) {
        points.push(near.x + offset(drawn.stream, i as u64) * (NEAR * ball.radius));
        weights.push(of_hit * near.weight);
    }

    let pixels = pixels_of(drawn.draws);
    let free = pixels.div_ceil(2 * EVERY as u64);
    let stream = drawn.stream.named(EIKONAL_POINTS);
    points.extend((0..free).map(|i| ball.center + in_ball(stream.at(i)) * ball.radius));
    let of_free = weight * drawn.objective.pixel_weight() * pixels as f32 / (2.0 * free as f32);
    weights.resize(points.len(), of_free);
    (points, weights)
}

/// A random vector for surface point `i`, with a uniform length of at most 1.
fn offset(stream: Stream, i: u64) -> Vec3 {
    let directions = stream.named(OFFSET_DIRECTIONS).at(i);
    let length = stream.named(OFFSET_LENGTHS).at(i).unit();
    let direction = in_ball(directions.at(0)) + in_ball(directions.at(1));
    direction.normalize_or_zero() * length as f32
}

/// A uniform random point in the unit ball.
pub(crate) fn in_ball(stream: Stream) -> Vec3 {
    <Vec3 as Vector3<f32>>::of(stream.in_ball().into())
}
