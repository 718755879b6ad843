//! Pictures of a fit while it runs.

use std::path::Path;

use dataset::View;
use film::{Film, write_image};
use metrics::psnr_where;
use render::{Scene, comparison, render};

use crate::error::FitError;
use crate::exposures::match_exposures;
use crate::fit::Fit;
use crate::run_folder::RunFolder;
use crate::solid::Solid;

/// The most pixels of a preview. Two passes of rays over 640 × 480 pixels took a fifth of the time
/// of the iterations between two previews.
const PIXELS: u64 = 1 << 17;

/// Writes the preview picture of the first held-out view, or else of the first view, with at most
/// 131,072 pixels. Returns the PSNR of a held-out view at this size, in dB.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray, or the picture cannot be written.
pub(crate) fn preview(fit: &Fit, folder: &RunFolder) -> Result<Option<f64>, FitError> {
    let Fit { model, file, photographs, clock, .. } = fit;
    let held_out = photographs.dataset.test.first();
    let Some(view) = held_out.or(photographs.dataset.train.first()) else { return Ok(None) };
    let camera = match (photographs.corrections.get(), held_out) {
        (Some(calibration), Some(view)) => calibration.apply_lens(&view.camera),
        (Some(calibration), None) => calibration.apply(0, &view.camera),
        (None, _) => view.camera,
    };
    let n = reduction([view.image.width, view.image.height]);
    let small = view.downscaled(n);
    let camera = camera.reduced(n, small.image.width, small.image.height);
    let mut shown = [View { camera, ..small }];
    if photographs.gains.is_some() {
        match_exposures(model, file, &mut shown, &|_| {})?;
    }

    let [shown] = shown;
    let solid = Solid::new(model, file);
    let colors = file.background_of([&shown]);
    let cameras = [shown.camera];
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let image = write_preview(&folder.preview(clock.iteration), &scene, 0, &shown.image)?;
    Ok(held_out.and_then(|_| psnr_where(&image, &shown.image, shown.used())))
}

/// The least whole number for which a view at 1/n of its width and height has at most [`PIXELS`]
/// pixels.
fn reduction([width, height]: [u32; 2]) -> u32 {
    let pixels = |n: u32| u64::from(width.div_ceil(n)) * u64::from(height.div_ceil(n));
    (1..=width.max(height)).find(|n| pixels(*n) <= PIXELS).unwrap_or(1)
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
) -> Result<Film, FitError> {
    let render = render(scene, camera, 1, 0, &|_| {})?;
    write_image(path, &comparison(target, &render))?;
    Ok(render.film)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_of_large_photographs_are_small() {
        let sizes = [[320, 320], [512, 256], [513, 256], [640, 480], [4032, 3024], [200_000, 1]];
        assert_eq!(sizes.map(reduction), [1, 1, 2, 2, 10, 2]);
    }
}
