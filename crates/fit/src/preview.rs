//! Pictures of a fit, for people.

use std::path::Path;

use film::{Film, contact_sheet, srgb_decode, srgb_encode};
use io::write_image;
use render::{Analytic, Formula, Scene, render};

/// The unit normals seen by a camera, as colours n/2 + 1/2 in display space, black where nothing is
/// hit.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn normal_map(scene: &Scene<'_, f32>, camera: usize) -> anyhow::Result<Film> {
    let shader = Analytic { formula: Formula::Normal, parameters: Vec::new() };
    let scene = Scene { shader: &shader, background: glam::Vec3::ZERO, ..*scene };
    let mut film = render(&scene, camera, 1, 0, &|_| {})?.film;
    film.pixels.iter_mut().for_each(|p| *p = p.map(srgb_decode));
    Ok(film)
}

/// The size of the difference in display space, as a grey picture, twice as bright as it is.
pub fn difference(a: &Film, b: &Film) -> Film {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| {
        let error =
            (0..3).map(|c| (srgb_encode(a[c]) - srgb_encode(b[c])).abs()).sum::<f32>() / 3.0;
        [srgb_decode((2.0 * error).min(1.0)); 3]
    });
    Film { width: a.width, height: a.height, pixels: pixels.collect() }
}

/// Writes target, render, normals and error of one view.
///
/// # Errors
/// If the field is not finite or the picture cannot be written.
pub fn write_preview(
    path: &Path,
    scene: &Scene<'_, f32>,
    camera: usize,
    target: &Film,
) -> anyhow::Result<Film> {
    let image = render(scene, camera, 1, 0, &|_| {})?.film;
    let normals = normal_map(scene, camera)?;
    let error = difference(&image, target);
    write_image(path, &contact_sheet(&[vec![target.clone(), image.clone(), normals, error]]))?;
    Ok(image)
}
