//! The pixels that a crease may cross, from single rays.

use field::{Real, Vector3};
use glam::DVec2;
use render::{Pixel, Primary, Scene};

/// Faces are compared around a square this far outside a pixel, in pixels. The room is for the
/// curvature of the surface, which the tangent plane of a hit leaves out.
const ROOM: f64 = 0.2;

/// Compared points along a side of the square.
const ALONG_SIDE: usize = 4;

/// Depths of compared points are those of the hit up to this factor. Beyond it, the tangent plane
/// says nothing.
const DEPTHS: f64 = 2.0;

/// For each pixel, whether the face around it differs from the face of its hit, in the tangent
/// plane of the hit. `primary` has `count` samples of each pixel.
///
/// A bent crease can enter a pixel between two of its corners and leave it there. No sample or
/// corner shows this, and the part of the crease in the pixel may be half a pixel long.
pub(super) fn near_creases<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    pixels: &[Pixel],
    count: usize,
) -> Vec<bool> {
    // The hit of each pixel that is closest to its middle: the number of the hit, and the distance.
    let mut central: Vec<Option<(usize, f64)>> = vec![None; pixels.len()];
    for (number, hit) in primary.hits.iter().enumerate() {
        let pixel = hit.sample / count;
        let away = primary.samples[hit.sample].sample.u - (pixels[pixel].corner() + 0.5);
        if central[pixel].is_none_or(|(_, least)| away.length_squared() < least) {
            central[pixel] = Some((number, away.length_squared()));
        }
    }
    let (mut x, mut owner) = (Vec::new(), Vec::new());
    for (index, (pixel, central)) in pixels.iter().zip(&central).enumerate() {
        let Some((number, _)) = central else { continue };
        let (hit, at) = (&primary.hits[*number], primary.surface.x[*number]);
        let camera = &scene.cameras[pixel.camera];
        let eye = R::Vec3::of(camera.eye);
        x.push(at);
        owner.push(index);
        for u in square(pixel.corner()) {
            let d = R::Vec3::of(camera.direction(u));
            let t = (at - eye).dot(hit.gradient) / d.dot(hit.gradient);
            if t > hit.t / R::of(DEPTHS) && t < hit.t * R::of(DEPTHS) {
                x.push(eye + d * t);
                owner.push(index);
            }
        }
    }
    let mut face = vec![0; x.len()];
    scene.field.faces(&x, &mut face);
    let mut near = vec![false; pixels.len()];
    let mut first = 0;
    for i in 0..x.len() {
        if owner[i] != owner[first] {
            first = i;
        }
        near[owner[i]] |= face[i] != face[first];
    }
    near
}

/// Points around the pixel with this corner.
fn square(corner: DVec2) -> impl Iterator<Item = DVec2> {
    let side = 1.0 + 2.0 * ROOM;
    let low = corner - ROOM;
    (0..ALONG_SIDE).flat_map(move |i| {
        let along = side * i as f64 / ALONG_SIDE as f64;
        [
            low + DVec2::new(along, 0.0),
            low + DVec2::new(side, along),
            low + DVec2::new(side - along, side),
            low + DVec2::new(0.0, side - along),
        ]
    })
}
