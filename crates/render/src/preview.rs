//! Preview pictures of a fit.

use crate::image::Render;
use film::{Film, contact_sheet, labelled, srgb_decode, srgb_encode};

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

/// A picture of one view, with four labelled images side by side: the photograph, its render, the
/// normals, and the [`difference`].
pub fn comparison(photograph: &Film, render: &Render) -> Film {
    let error = difference(&render.film, photograph);
    let all = [
        ("photograph", photograph),
        ("render", &render.film),
        ("normals", &render.normals),
        ("error", &error),
    ];
    contact_sheet(&[all.map(|(name, film)| labelled(film, name)).to_vec()])
}
