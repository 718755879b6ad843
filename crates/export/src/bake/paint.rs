//! The colours of a texture.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use mesh::{Mesh, Texture};
use rayon::prelude::*;
use render::{InvalidField, Scene};

use crate::bake::GREY;
use crate::bake::colours::{CHUNK, is_unseen, mean_radiance, seen, words};
use crate::bake::texels::{Texel, texels};

/// The farthest that the surface may be from a face, in bounding radii: a longer step to the
/// surface is left out.
const LARGEST_STEP: f32 = 0.01;

/// Paints the texture of a mesh with the colours of [`bake`](crate::bake::bake).
///
/// The mesh has its normals, and is about the origin of the scene. Each texel shows the surface
/// near a point of a face. The cameras that see it are those that see all three vertices of the
/// face, or else those that see one. Texels away from all charts get the mean of the others, so
/// that smaller copies of the image have no dark seams. `progress` gets the fraction done, on any
/// thread. The image has the same bits on any number of threads.
///
/// Returns the share of the texels of faces that no camera sees; these are grey.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the texture is not one of the mesh.
pub fn paint(
    scene: &Scene<'_, f32>,
    mesh: &Mesh,
    texture: &mut Texture,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<f64, InvalidField> {
    let half = |done: f64| progress(0.5 * done);
    let seen = seen(scene, &mesh.vertices, &mesh.normals, &half)?;
    let texels = texels(texture);
    let (done, all) = (AtomicUsize::new(0), texels.len());
    let mut colors = vec![GREY; texels.len()];
    let chunks = texels.par_chunks(CHUNK).zip(colors.par_chunks_mut(CHUNK));
    let unseen: Vec<usize> = chunks
        // A program that stops a command unwinds from `progress`.
        .panic_fuse()
        .map(|(texels, colors)| {
            let unseen = paint_chunk(scene, mesh, &seen, texels, colors);
            let before = done.fetch_add(texels.len(), Ordering::Relaxed);
            progress(0.5 + 0.5 * (before + texels.len()) as f64 / all as f64);
            unseen
        })
        .collect();
    let sum: DVec3 = colors.iter().map(|c| c.as_dvec3()).sum();
    let mean = sum / colors.len().max(1) as f64;
    texture.image.pixels.fill(mean.as_vec3().to_array());
    for (texel, color) in texels.iter().zip(&colors) {
        texture.image.pixels[texel.index] = color.to_array();
    }
    let inside = texels.iter().filter(|texel| texel.is_inside).count();
    Ok(unseen.iter().sum::<usize>() as f64 / inside.max(1) as f64)
}

/// Writes the colours of some texels, and leaves those that no camera sees. Returns the number of
/// these in faces.
fn paint_chunk(
    scene: &Scene<'_, f32>,
    mesh: &Mesh,
    seen: &[u64],
    texels: &[Texel],
    colors: &mut [Vec3],
) -> usize {
    let words = words(scene);
    let of = |of: &[Vec3], texel: &Texel| -> Vec3 {
        let [a, b, c] = mesh.faces[texel.face].map(|v| of[v as usize]);
        a * texel.weights.x + b * texel.weights.y + c * texel.weights.z
    };
    let mut points: Vec<Vec3> = texels.iter().map(|t| of(&mesh.vertices, t)).collect();
    let mut normals: Vec<Vec3> = texels.iter().map(|t| of(&mesh.normals, t)).collect();
    onto_surface(scene, &mut points, &mut normals);
    let mut cameras = Vec::with_capacity(words * texels.len());
    for texel in texels {
        let [a, b, c] = mesh.faces[texel.face].map(|v| &seen[v as usize * words..][..words]);
        let all = (0..words).map(|w| a[w] & b[w] & c[w]);
        let none = all.clone().all(|word| word == 0);
        cameras.extend(all.enumerate().map(|(w, all)| if none { a[w] | b[w] | c[w] } else { all }));
    }
    mean_radiance(scene, &points, &normals, &cameras, colors);
    let of_texels = texels.iter().zip(cameras.chunks(words));
    of_texels.filter(|(texel, cameras)| texel.is_inside && is_unseen(cameras)).count()
}

/// Moves points onto the surface by a Newton step, and sets their unit normals to those there.
fn onto_surface(scene: &Scene<'_, f32>, points: &mut [Vec3], normals: &mut [Vec3]) {
    let (mut f, mut gradients) = (vec![0.0; points.len()], vec![Vec3::ZERO; points.len()]);
    scene.field.value_gradient(points, &mut f, &mut gradients);
    let largest = LARGEST_STEP * scene.bounds.radius as f32;
    for (i, (f, gradient)) in f.iter().zip(&gradients).enumerate() {
        let step = *gradient * (f / gradient.length_squared());
        if step.is_finite() && step.length() < largest {
            points[i] -= step;
        }
        normals[i] = gradient.try_normalize().unwrap_or(normals[i].normalize_or(Vec3::Z));
    }
}

#[cfg(test)]
mod tests {
    use field::UniformBackground;
    use field::{Shape, Sphere};
    use glam::{DVec2, Vec2};
    use render::{Analytic, Camera, Formula};

    use super::*;
    use crate::bake::unwrap;

    /// A ball of radius 1 with the radiance n/2 + 1/2, seen from above and from below.
    #[test]
    fn a_painted_ball_has_the_colour_of_each_point_at_its_place_in_the_image() {
        let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
        let shader = Analytic::<f32> { formula: Formula::Normal, parameters: Vec::new() };
        let (focal, middle) = (DVec2::splat(64.0), DVec2::splat(32.0));
        let camera = |z: f64| {
            let eye = DVec3::new(0.0, 0.0, z);
            Camera::look_at(64, 64, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap()
        };
        let (above, below) = (camera(4.0), camera(-4.0));
        let bounds = Sphere { center: DVec3::ZERO, radius: 1.5 };
        let background = UniformBackground(Vec3::ZERO);
        let mesh = mesh::extract(&Shape::<f64>::sphere([0.0; 3], 1.0), &bounds, 24, &|_| {});
        let unwrapped = unwrap(&mesh, 256, &|_| {}).unwrap();
        let painted = |cameras: &[Camera]| {
            let scene = Scene::new(&ball, &shader, cameras, &bounds, &background);
            let mut texture = unwrapped.texture.clone();
            let unseen = paint(&scene, &mesh, &mut texture, &|_| {}).unwrap();
            (texture, unseen)
        };
        let (texture, unseen) = painted(&[above, below]);
        // From a distance of 4, a camera sees the cap above z = 1/4.
        assert!((0.15..0.3).contains(&unseen), "{unseen} of the ball is unseen, of 1/4");
        let image = &texture.image;
        let at = |p: Vec2| {
            let (x, y) = (p.x * image.width as f32, p.y * image.height as f32);
            Vec3::from(image.at(x as u32, y as u32))
        };
        let mut compared = 0;
        for (i, corners) in texture.corners.iter().enumerate() {
            let mean = |points: [Vec3; 3]| (points[0] + points[1] + points[2]) / 3.0;
            let middle = mean(mesh.faces[i].map(|v| mesh.vertices[v as usize])).normalize();
            let place = mean(corners.map(|c| texture.points[c as usize].extend(0.0))).truncate();
            if middle.z.abs() > 0.4 {
                // A texel is about 1/60 of the radius wide.
                let error = (at(place) - (middle * 0.5 + 0.5)).abs().max_element();
                assert!(error < 0.02, "face {i} around {middle}: off by {error}");
                compared += 1;
            } else if middle.z.abs() < 0.1 {
                assert!((at(place) - GREY).length() < 1e-5, "face {i} around {middle}");
            }
        }
        assert!(compared > 500);
        let (image, unseen) = painted(&[]);
        assert!(unseen == 1.0);
        assert!(image.image.pixels.iter().all(|p| (Vec3::from(*p) - GREY).length() < 1e-5));
    }
}
