//! Preview pictures of a fit.

use std::path::Path;

use film::{Film, contact_sheet, labelled, srgb_decode, srgb_encode};
use io::write_image;
use render::{Analytic, Formula, InvalidField, Scene, UniformBackground, render};

/// The unit normals n of the first hits, as colours n/2 + 1/2 in display space; black without a
/// hit.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the scene has no camera of this number.
pub fn normal_map(scene: &Scene<'_, f32>, camera: usize) -> Result<Film, InvalidField> {
    let shader = Analytic { formula: Formula::Normal, parameters: Vec::new() };
    let scene =
        Scene { shader: &shader, background: &UniformBackground(glam::Vec3::ZERO), ..*scene };
    let mut film = render(&scene, camera, 1, 0, &|_| {})?.film;
    film.pixels.iter_mut().for_each(|p| *p = p.map(srgb_decode));
    Ok(film)
}

/// The absolute difference of two images in display space, as a grey image: the mean over the
/// channels times 2, clipped at 1.
///
/// The images must have the same size.
pub fn difference(a: &Film, b: &Film) -> Film {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| {
        let error =
            (0..3).map(|c| (srgb_encode(a[c]) - srgb_encode(b[c])).abs()).sum::<f32>() / 3.0;
        [srgb_decode((2.0 * error).min(1.0)); 3]
    });
    Film { width: a.width, height: a.height, pixels: pixels.collect() }
}

/// A picture of one view, with four labelled images side by side: the photograph, its render
/// `image`, the normals, and the [`difference`].
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the scene has no camera of this number.
pub fn comparison(
    scene: &Scene<'_, f32>,
    camera: usize,
    photograph: &Film,
    image: &Film,
) -> Result<Film, InvalidField> {
    let normals = normal_map(scene, camera)?;
    let error = difference(image, photograph);
    let all =
        [("photograph", photograph), ("render", image), ("normals", &normals), ("error", &error)];
    Ok(contact_sheet(&[all.map(|(name, film)| labelled(film, name)).to_vec()]))
}

/// Renders one view, and writes its [`comparison`] with the photograph `target` to `path`. Returns
/// the rendered image.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray, or the picture cannot be written.
///
/// # Panics
/// If the scene has no camera of this number.
pub fn write_preview(
    path: &Path,
    scene: &Scene<'_, f32>,
    camera: usize,
    target: &Film,
) -> anyhow::Result<Film> {
    let image = render(scene, camera, 1, 0, &|_| {})?.film;
    write_image(path, &comparison(scene, camera, target, &image)?)?;
    Ok(image)
}
