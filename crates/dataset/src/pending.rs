//! From a camera and the names of its files to a view.

use std::path::{Path, PathBuf};

use glam::DVec2;

use super::View;
use super::lens::Lens;
use film::{Film, srgb_encode};
use io::InputError;
use io::read_image;
use render::Camera;

/// A view whose image is still to be read.
pub(super) struct Pending {
    pub(super) name: String,
    pub(super) path: PathBuf,
    /// A mask image of its own, where there is one.
    pub(super) mask: Option<PathBuf>,
    /// The pinhole part of the camera that took the photograph.
    pub(super) camera: Camera,
    /// What the lens adds to it; removed from the photograph as it is read.
    pub(super) lens: Lens,
    /// The JSON key, line or array that the camera's size came from, for messages.
    pub(super) size_from: String,
}

impl Pending {
    /// Reads the image and the mask, without the lens's distortion, at 1/`downscale` of the size.
    ///
    /// # Errors
    /// If a file is missing or wrong, or the distortion cannot be undone.
    pub(super) fn read(self, downscale: u32) -> Result<View, InputError> {
        let Pending { name, path, mask, camera, lens, size_from } = self;
        let (image, alpha) = read_image(&path)?;
        if (image.width, image.height) != (camera.width, camera.height) {
            let expected = format!("{} x {}, as {size_from} says", camera.width, camera.height);
            return Err(InputError::new(
                &path,
                "size",
                format!("{} x {}", image.width, image.height),
                expected,
            ));
        }
        if let Some(bad) = image.pixels.as_flattened().iter().find(|v| !v.is_finite()) {
            return Err(InputError::new(&path, "pixels", bad, "finite numbers"));
        }
        // The colour under a transparent pixel means nothing: over black, transparency is part of
        // the photograph.
        let image = match &alpha {
            Some(alpha) => Film {
                pixels: image.pixels.iter().zip(alpha).map(|(p, a)| p.map(|c| c * a)).collect(),
                ..image
            },
            None => image,
        };
        let mask = match (alpha, mask) {
            (Some(alpha), _) => Some(coverage_film(&image, &alpha)),
            (None, Some(mask)) => Some(read_mask(&mask, &camera)?),
            (None, None) => None,
        };
        let (image, mask, camera) = if lens.is_negligible(&camera) {
            (image, mask, camera)
        } else {
            let ideal = lens.pinhole(&camera).ok_or_else(|| {
                let expected =
                    "a lens that most of the image can be freed of (undistort the images first)";
                InputError::new(&path, "distortion", format!("{lens:?}"), expected)
            })?;
            let straight = |film: &Film| lens.undistort(film, &camera, &ideal);
            (straight(&image), mask.as_ref().map(straight), ideal)
        };
        let (image, mask, camera) = if downscale > 1 {
            let small = image.downscaled(downscale);
            (small, mask.map(|mask| mask.downscaled(downscale)), at_fraction(camera, downscale))
        } else {
            (image, mask, camera)
        };
        let mask = mask.map(|mask| mask.pixels.iter().map(|p| p[0]).collect());
        Ok(View { name, path, camera, image, mask })
    }
}

/// The camera of an image of which every pixel is the mean of n × n (at the right and lower border,
/// of what is left).
fn at_fraction(camera: Camera, n: u32) -> Camera {
    let (width, height) = (camera.width.div_ceil(n), camera.height.div_ceil(n));
    let scale = DVec2::splat(f64::from(n));
    Camera {
        width,
        height,
        focal: camera.focal / scale,
        principal: camera.principal / scale,
        ..camera
    }
}

/// Coverage in [0, 1] as a grey film of the image's size.
fn coverage_film(image: &Film, coverage: &[f32]) -> Film {
    Film {
        width: image.width,
        height: image.height,
        pixels: coverage.iter().map(|&c| [c; 3]).collect(),
    }
}

/// A mask image: white is the object, black is not.
fn read_mask(path: &Path, camera: &Camera) -> Result<Film, InputError> {
    let (mask, alpha) = read_image(path)?;
    if (mask.width, mask.height) != (camera.width, camera.height) {
        let expected = format!("{} x {}, as the photograph", camera.width, camera.height);
        return Err(InputError::new(
            path,
            "size",
            format!("{} x {}", mask.width, mask.height),
            expected,
        ));
    }
    // Masks are coverage, not light: the transfer function is taken back.
    let shown: Vec<f32> = mask.pixels.iter().map(|p| srgb_encode(p[0]).clamp(0.0, 1.0)).collect();
    // A mask in the alpha channel leaves nothing to see in the colours.
    let in_alpha = alpha.filter(|a| a.iter().any(|a| *a < 1.0));
    Ok(coverage_film(&mask, in_alpha.as_ref().unwrap_or(&shown)))
}
