//! The bending term: a prior for even surfaces where the photographs are even.
//!
//! Where photographs show no pattern, the radiance of the head can explain any shape, and flat
//! surfaces got dents. The term is the change of ∇f over a short step, ρ(∇f(x + h t) − ∇f(x)) with
//! ρ(v) = √(|v|² + δ²) − δ: a total variation of normals, which allows creases. The normal
//! smoothness of Oechsle, Peng and Geiger, "UNISURF", ICCV 2021, section 3.4, has the norm of the
//! same difference; the weight by the contrast of the photograph is that of disparities in Godard,
//! Mac Aodha and Brostow, "Unsupervised Monocular Depth Estimation with Left-Right Consistency",
//! CVPR 2017, section 3.3, with a rational function in the place of the exponential.

use film::Film;
use glam::Vec3;
use random::Name;

use crate::drawn::{Drawn, NearPoint, one_of};
use crate::eikonal::in_ball;
use crate::photometry::{Draw, Level};
use crate::reversed::Reversed;

/// The term is evaluated at one of this many points of the surface, with this many times its
/// weight.
const EVERY: usize = 4;

/// The step h, in bounding radii. docs/detail.md has other steps.
const STEP: f32 = 0.06;

/// δ: changes below it count less.
const ROUNDING: f32 = 0.02;

/// The contrast at which the weight is a half.
const CONTRAST: f32 = 0.05;

/// Radiance that is added to the mean in a contrast: dark pixels are noisy.
const DARK: f32 = 0.02;

/// Offsets to the middles of the squares of 3 × 3 pixels over which the contrast of a pixel is
/// taken.
const SQUARES: [(i32, i32); 5] = [(0, 0), (-2, 0), (2, 0), (0, -2), (0, 2)];

const BENDING_HITS: Name = Name::new("points of the bending term", 32);
const BENDING_DIRECTIONS: Name = Name::new("steps of the bending term", 33);

/// Adds the term at points of the surface.
pub(crate) fn bending(drawn: &Drawn<'_>, surface: &[NearPoint], weight: f32, out: &mut Reversed) {
    if weight == 0.0 {
        return;
    }
    let Drawn { objective, draws, stream, .. } = *drawn;
    let step = STEP * objective.scene.bounding_ball().radius;
    let weight = weight * drawn.objective.pixel_weight() * EVERY as f32;
    let directions = stream.named(BENDING_DIRECTIONS);

    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for (i, near) in one_of(EVERY, surface.iter().enumerate(), stream.named(BENDING_HITS)) {
        let direction = in_ball(directions.at(i as u64)).normalize_or_zero();
        points.extend([near.x, near.x + direction * step]);
        let even = evenness(objective.targets.level, &draws[near.pixel]);
        weights.push(weight * near.weight * even);
    }

    let (mut f, mut g) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
    objective.scene.field.value_gradient(&points, &mut f, &mut g);
    for ((ends, g), weight) in points.chunks(2).zip(g.chunks(2)).zip(weights) {
        let c = bending_slope(g[1] - g[0]) * weight;
        out.push_gradient(ends[0], -c);
        out.push_gradient(ends[1], c);
    }
}

/// How even the photograph is around a pixel, from 0 to 1.
fn evenness(level: &Level, draw: &Draw) -> f32 {
    let image = &level.photographs[draw.view as usize].image;
    1.0 / (1.0 + (contrast(image, draw) / CONTRAST).powi(2))
}

/// The derivative of ρ at a change of ∇f.
fn bending_slope(change: Vec3) -> Vec3 {
    change / (change.length_squared() + ROUNDING * ROUNDING).sqrt()
}

/// The largest difference between the squares around a pixel over their mean: that of the channel
/// where it is largest.
///
/// The noise of single pixels is a pattern that no surface has: in a dark part of a photograph it
/// is several times the contrast at which the weight is a half.
fn contrast(image: &Film, draw: &Draw) -> f32 {
    let (mut low, mut high, mut sum) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::ZERO);
    for (dx, dy) in SQUARES {
        let rgb = mean_around(image, i32::from(draw.x) + dx, i32::from(draw.y) + dy);
        (low, high, sum) = (low.min(rgb), high.max(rgb), sum + rgb);
    }
    ((high - low) / (sum / SQUARES.len() as f32 + DARK)).max_element()
}

/// The mean of 3 × 3 pixels. Beyond the film, its last pixels go on.
fn mean_around(image: &Film, x: i32, y: i32) -> Vec3 {
    let place = |v: i32, side: u32| v.clamp(0, side as i32 - 1) as u32;
    let at = |(i, j): (i32, i32)| image.at(place(x + i, image.width), place(y + j, image.height));
    let places = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j)));
    places.map(|place| Vec3::from(at(place))).sum::<Vec3>() / 9.0
}

#[cfg(test)]
mod tests {
    use random::Stream;

    use super::*;

    const NOISE: Name = Name::other("noise of a photograph");

    #[test]
    fn the_derivative_of_the_term_matches_differences() {
        let rho = |v: Vec3| f64::from(v.length_squared() + ROUNDING * ROUNDING).sqrt();
        for change in [Vec3::ZERO, Vec3::new(0.01, -0.02, 0.005), Vec3::new(-0.5, 0.2, 0.9)] {
            let slope = bending_slope(change);
            assert!(slope.length() < 1.0);
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                let h = 1e-3;
                let difference = (rho(change + axis * h) - rho(change - axis * h)) / 2e-3;
                assert!((f64::from(slope.dot(axis)) - difference).abs() < 2e-3, "{change} {axis}");
            }
        }
    }

    #[test]
    fn the_contrast_of_an_edge_is_large_and_that_of_an_even_part_is_zero() {
        let pixel = |x, y| Draw { view: 0, x, y, count: 1 };
        let mut image = Film { width: 16, height: 16, pixels: vec![[0.3, 0.5, 0.4]; 256] };
        for y in 0..16 {
            image.pixels[16 * y + 12..16 * (y + 1)].fill([0.6, 0.5, 0.4]);
        }
        assert_eq!(contrast(&image, &pixel(4, 0)), 0.0);
        // The square at the right shows 0.6, those at the left 0.3, and the others a third of each.
        let expected = 0.3 / ((0.3 + 3.0 * 0.4 + 0.6) / 5.0 + DARK);
        assert!((contrast(&image, &pixel(11, 8)) - expected).abs() < 1e-5);
    }

    #[test]
    fn noise_of_single_pixels_is_little_contrast() {
        // Single pixels differ by about 0.12 of the mean with `DARK`, the squares by 0.03.
        let stream = Stream::of_seed(1).named(NOISE);
        let noisy = |i: u64| [0.045 + 0.01 * stream.at(i).unit() as f32; 3];
        let image = Film { width: 64, height: 64, pixels: (0..64 * 64).map(noisy).collect() };
        let places = (3..61).flat_map(|y| (3..61).map(move |x| Draw { view: 0, x, y, count: 1 }));
        let found: Vec<f32> = places.map(|draw| contrast(&image, &draw)).collect();
        let mean = found.iter().sum::<f32>() / found.len() as f32;
        println!("mean contrast of noise: {mean}");
        assert!(mean < 0.05, "{mean}");
    }
}
