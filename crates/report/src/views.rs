//! Photographs of a run beside its renders.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dataset::View;
use film::{Film, srgb_encode};
use fit::Solid;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use metrics::psnr_where;
use render::difference;
use render::{Camera, render};
use serde::Serialize;

use crate::{Detail, Error, Run};

/// The quality of JPEG pictures, 1 to 100.
const QUALITY: u8 = 85;

/// A view: its camera and its pictures.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Picture {
    name: String,
    held_out: bool,
    /// PSNR of the render, in dB, at the size of the pictures; `None` if a mask leaves all of their
    /// pixels out.
    psnr: Option<f64>,
    width: u32,
    height: u32,
    camera: Place,
    /// The pictures, as JPEG files in base64: photograph, render, error.
    pictures: [String; 3],
}

/// A camera.
#[derive(Clone, Debug, Serialize)]
struct Place {
    eye: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
    forward: [f64; 3],
    /// The tangents of the angles from the optical axis to the left, right, lower and upper border
    /// of the film, without distortion.
    borders: [f64; 4],
}

impl Place {
    fn of(camera: &Camera) -> Self {
        let (focal, principal) = (camera.focal, camera.principal);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        Place {
            eye: camera.eye.to_array(),
            right: camera.right.to_array(),
            up: camera.up.to_array(),
            forward: camera.forward.to_array(),
            borders: [
                -principal.x / focal.x,
                (width - principal.x) / focal.x,
                (principal.y - height) / focal.y,
                principal.y / focal.y,
            ],
        }
    }
}

/// The views of a page, in the order of the data set, training views first.
pub(crate) fn views(
    run: &Run<'_>,
    solid: &Solid<'_>,
    detail: Detail,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Picture>, Error> {
    let chosen = chosen(&run.dataset.train, &run.dataset.test, detail.views);
    let small: Vec<View> = chosen.iter().map(|(view, _)| reduced(view, detail.side)).collect();
    let cameras: Vec<Camera> = small.iter().map(|view| view.camera).collect();
    let colors = run.file.background_of(chosen.iter().map(|(view, _)| *view));
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let mut pictures = Vec::new();
    for (i, ((_, held_out), view)) in chosen.iter().zip(&small).enumerate() {
        let done = |p| progress((i as f64 + p) / chosen.len() as f64);
        let image = render(&scene, i, detail.spp, run.file.options.seed, &done)?.film;
        let View { camera, image: photograph, .. } = view;
        let psnr = psnr_where(&image, photograph, view.used()).filter(|psnr| psnr.is_finite());
        let error = difference(&image, photograph);
        pictures.push(Picture {
            name: view.name.clone(),
            held_out: *held_out,
            psnr,
            width: camera.width,
            height: camera.height,
            camera: Place::of(camera),
            pictures: [jpeg(photograph)?, jpeg(&image)?, jpeg(&error)?],
        });
    }
    Ok(pictures)
}

/// At most `most` views, and whether each is held out: training views at equal steps, then held-out
/// views. Held-out views have up to half of the places, or more if training views leave them.
fn chosen<'a>(train: &'a [View], test: &'a [View], most: usize) -> Vec<(&'a View, bool)> {
    let of_test = test.len().min((most / 2).max(most.saturating_sub(train.len())));
    let of_train = train.len().min(most - of_test);
    let steps = |views: &'a [View], n: usize, held_out| {
        (0..n).map(move |i| (&views[i * views.len() / n], held_out))
    };
    steps(train, of_train, false).chain(steps(test, of_test, true)).collect()
}

/// The view with at most `side` pixels along each side.
fn reduced(view: &View, side: u32) -> View {
    view.downscaled(view.camera.width.max(view.camera.height).div_ceil(side).max(1))
}

/// A JPEG file of an image, in base64.
fn jpeg(film: &Film) -> Result<String, Error> {
    let byte = |x: f32| (255.0 * srgb_encode(x)).round() as u8;
    let bytes: Vec<u8> = film.pixels.iter().flat_map(|p| p.map(byte)).collect();
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, QUALITY)
        .write_image(&bytes, film.width, film.height, ExtendedColorType::Rgb8)
        .map_err(Error::Picture)?;
    Ok(STANDARD.encode(file))
}
