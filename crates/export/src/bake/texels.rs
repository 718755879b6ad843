//! The texels of an image that show a mesh.

use glam::{Vec2, Vec3};
use mesh::Texture;

/// Texels around each chart that show its nearest face: interpolation at a border reads them.
pub(crate) const GUTTER: u32 = 2;

/// A texel that shows a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Texel {
    /// The index in the image.
    pub(crate) index: usize,
    /// The face of the mesh.
    pub(crate) face: usize,
    /// The barycentric coordinates of its point of the face.
    pub(crate) weights: Vec3,
    /// Whether the centre lies in the face.
    pub(crate) is_inside: bool,
}

/// The texels whose centre lies in a face or within [`GUTTER`] texels of one, in the order of the
/// image. Each shows the nearest point of the nearest face.
pub(crate) fn texels(texture: &Texture) -> Vec<Texel> {
    let (width, height) = (texture.image.width, texture.image.height);
    let size = Vec2::new(width as f32, height as f32);
    let mut nearest: Vec<Option<(f32, usize, Vec3)>> = vec![None; width as usize * height as usize];
    for (face, corners) in texture.corners.iter().enumerate() {
        let corners = corners.map(|c| texture.points[c as usize] * size);
        let gutter = Vec2::splat(GUTTER as f32);
        let low = corners[0].min(corners[1]).min(corners[2]) - gutter;
        let high = corners[0].max(corners[1]).max(corners[2]) + gutter;
        let (low, high) = (low.max(Vec2::ZERO), high.min(size));
        for y in low.y as u32..high.y.ceil() as u32 {
            for x in low.x as u32..high.x.ceil() as u32 {
                let center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let (distance, weights) = nearest_point(corners, center);
                let index = y as usize * width as usize + x as usize;
                if distance <= gutter.x && nearest[index].is_none_or(|(d, ..)| distance < d) {
                    nearest[index] = Some((distance, face, weights));
                }
            }
        }
    }
    let texel = |(index, nearest): (usize, Option<(f32, usize, Vec3)>)| {
        let (distance, face, weights) = nearest?;
        Some(Texel { index, face, weights, is_inside: distance == 0.0 })
    };
    nearest.into_iter().enumerate().filter_map(texel).collect()
}

/// The distance of a point from a triangle, and the barycentric coordinates of the nearest point.
fn nearest_point([a, b, c]: [Vec2; 3], p: Vec2) -> (f32, Vec3) {
    let area = (b - a).perp_dot(c - a);
    let weights = Vec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), 0.0) / area;
    let weights = weights.with_z(1.0 - weights.x - weights.y);
    if weights.min_element() >= 0.0 {
        return (0.0, weights);
    }
    let edge = |from: Vec2, to: Vec2| {
        let along = to - from;
        let t = ((p - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        // An edge without a length is its start.
        let t = if t.is_finite() { t } else { 0.0 };
        ((from + along * t).distance(p), t)
    };
    let edges = [
        (edge(a, b), Vec3::X, Vec3::Y),
        (edge(b, c), Vec3::Y, Vec3::Z),
        (edge(c, a), Vec3::Z, Vec3::X),
    ];
    let nearest = edges.into_iter().min_by(|(a, ..), (b, ..)| a.0.total_cmp(&b.0));
    nearest
        .map_or((f32::INFINITY, Vec3::X), |((distance, t), from, to)| (distance, from.lerp(to, t)))
}

#[cfg(test)]
mod tests {
    use film::Film;

    use super::*;

    #[test]
    fn the_nearest_point_of_a_triangle_is_inside_on_an_edge_or_a_corner() {
        let triangle = [Vec2::ZERO, Vec2::new(4.0, 0.0), Vec2::new(0.0, 4.0)];
        for (p, distance, weights) in [
            (Vec2::new(1.0, 1.0), 0.0, [0.5, 0.25, 0.25]),
            (Vec2::new(3.0, -2.0), 2.0, [0.25, 0.75, 0.0]),
            (Vec2::new(-3.0, -4.0), 5.0, [1.0, 0.0, 0.0]),
            (Vec2::new(4.0, 4.0), 8f32.sqrt(), [0.0, 0.5, 0.5]),
        ] {
            let (found, at) = nearest_point(triangle, p);
            assert!((found - distance).abs() < 1e-5 && (at - Vec3::from(weights)).length() < 1e-5);
        }
        // All corners at one place.
        let (distance, at) = nearest_point([Vec2::ONE; 3], Vec2::ZERO);
        assert_eq!((distance, at.element_sum()), (2f32.sqrt(), 1.0));
    }

    #[test]
    fn texels_show_the_nearest_face_up_to_the_gutter() {
        let corner = |x: f32, y: f32| Vec2::new(x, y) / 16.0;
        let texture = Texture {
            image: Film::new(16, 16),
            points: vec![
                corner(4.0, 4.0),
                corner(10.0, 4.0),
                corner(4.0, 10.0),
                corner(10.0, 10.0),
            ],
            vertices: vec![0, 1, 2, 3],
            corners: vec![[0, 1, 2], [2, 1, 3]],
        };
        let texels = texels(&texture);
        let at = |x: usize, y: usize| texels.iter().find(|t| t.index == 16 * y + x);
        assert_eq!((at(4, 4).unwrap().face, at(9, 9).unwrap().face), (0, 1));
        assert!(at(2, 6).is_some() && at(1, 6).is_none() && at(2, 2).is_none());
        assert!(texels.iter().all(|t| (t.weights.element_sum() - 1.0).abs() < 1e-6));
        assert!(texels.is_sorted_by_key(|t| t.index));
    }
}
