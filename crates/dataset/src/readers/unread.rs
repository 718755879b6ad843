//! A view whose image is not read yet, and the steps from its files to a [`View`].

use std::path::{Path, PathBuf};

use glam::DVec2;

use crate::readers::images::sibling_mask;
use crate::readers::lens::Lens;
use crate::readers::{Mask, MaskKind, View};
use files::InputError;
use film::{Film, srgb_encode};
use film::{image_size, read_image_of, reading_memory};
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// A view whose image is not read yet.
#[derive(Debug)]
pub struct UnreadView {
    pub(crate) name: String,
    /// The image file.
    pub(crate) path: PathBuf,
    /// A separate mask image, if the data set has one.
    pub(crate) mask: Option<(MaskKind, PathBuf)>,
    /// The pinhole part of the camera that took the photograph.
    pub(crate) camera: Camera,
    /// Distortion and skew, to be removed from the photograph.
    pub(crate) lens: Lens,
    /// The file or the record that states the camera's size; without one it is that of the image.
    pub(crate) size_source: Option<String>,
    /// The size in the camera file, if the image is a reduced copy of another size.
    pub(crate) full_size: Option<[u32; 2]>,
}

/// A photograph and its mask, in the geometry of one pinhole camera.
struct Photograph {
    camera: Camera,
    image: Film,
    /// The mask's numbers as a grey film.
    mask: Option<(MaskKind, Film)>,
}

/// A pixel with less alpha is cut out.
const HALF: f32 = 0.5;

/// Bytes of memory for each pixel of a photograph whose distortion is removed: the result.
const MEMORY_PER_UNDISTORTED_PIXEL: u64 = 12;

/// Bytes of memory for each pixel of a mask in addition to that of an image: its display values,
/// and coverage as a film.
const MEMORY_PER_MASK_PIXEL: u64 = 16;

/// The least and the largest focal length, in parts of the larger side of the photograph: fields of
/// view of 180 degrees and of a thousandth of a degree.
const FOCAL: [f64; 2] = [1e-3, 1e5];

/// The largest coordinate of the principal point, in the same parts: a photograph can be a small
/// part of a larger one.
const MOST_OFF_FILM: f64 = 1e3;

/// Programs round the sides of a reduced image to whole pixels, down or up.
const ROUNDING: f64 = 1.5;

/// A view's [`UnreadView::size_source`] in messages.
fn source_of(size: &Option<String>) -> &str {
    size.as_deref().unwrap_or("the image")
}

impl UnreadView {
    /// A view without a mask, whose camera has the size of the image.
    pub(crate) fn of_image(name: String, path: PathBuf, camera: Camera, lens: Lens) -> Self {
        UnreadView { name, path, mask: None, camera, lens, size_source: None, full_size: None }
    }

    /// The image's name in the data set.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The pinhole part of the camera that took the photograph.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The view with the mask of the object that has the image's name in `masks/`, if there is one.
    pub(crate) fn with_object_mask(self, folder: &Path) -> Self {
        let mask = sibling_mask(folder, &self.name).map(|mask| (MaskKind::Object, mask));
        UnreadView { mask, ..self }
    }

    /// Checks that the focal lengths and the principal point are those of a camera. `source` is the
    /// data set, for the message of the error.
    ///
    /// # Errors
    /// If a number is out of range.
    pub fn check_lens(&self, source: &Path) -> Result<()> {
        let Camera { width, height, focal, principal, .. } = self.camera;
        let largest = f64::from(width.max(height));
        let [least, most] = FOCAL.map(|share| share * largest);
        let refuse = |field: &str, found: DVec2, expected: String| {
            let field = format!("{}: {field}", self.name);
            let found = format!("{:e}, {:e} pixels", found.x, found.y);
            Err(InputError::new(source, field, found, expected))
        };
        if !(focal.min_element() >= least && focal.max_element() <= most) {
            return refuse("focal length", focal, format!("{least:.1} to {most:.0} pixels"));
        }
        let farthest = MOST_OFF_FILM * largest;
        if !principal.is_finite() || principal.abs().max_element() > farthest {
            return refuse("principal point", principal, format!("at most {farthest:.0} pixels"));
        }
        Ok(())
    }

    /// Width and height of the photograph in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.camera.width, self.camera.height]
    }

    /// The view of an image that is smaller (or larger) than the camera file says: the intrinsics
    /// are scaled, in x and in y, to the size of the image file.
    ///
    /// # Errors
    /// If the image cannot be read, or has another aspect ratio.
    pub(crate) fn of_reduced_image(mut self) -> Result<Self> {
        let camera = &mut self.camera;
        let full = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let (width, height) = image_size(&self.path)?;
        let to_vector = |(w, h): (u32, u32)| DVec2::new(f64::from(w), f64::from(h));
        let fits = |size: &(u32, u32)| {
            let size = to_vector(*size);
            let scale = (size / full).max_element();
            (full * scale - size).max_element() <= ROUNDING
        };
        // An image may be turned by its EXIF orientation.
        let size = [(width, height), (height, width)].into_iter().find(fits).ok_or_else(|| {
            let [w, h] = [camera.width, camera.height];
            let expected =
                format!("the aspect ratio of {w} x {h} (from {})", source_of(&self.size_source));
            InputError::new(&self.path, "size", format!("{width} x {height}"), expected)
        })?;
        if size != (camera.width, camera.height) {
            let scale = to_vector(size) / full;
            self.full_size = Some([camera.width, camera.height]);
            (camera.width, camera.height) = size;
            camera.focal *= scale;
            camera.principal *= scale;
            self.lens.skew *= scale.x;
            self.mask = self.mask.map(|(kind, mask)| (kind, copy_of_mask(&mask, &self.path)));
        }
        Ok(self)
    }

    /// An estimate of the memory for [`read`](Self::read), in bytes.
    pub fn reading_memory(&self) -> u64 {
        let of_mask = |mask: &(MaskKind, PathBuf)| reading_memory(&mask.1) + MEMORY_PER_MASK_PIXEL;
        let of_lens = if self.lens.is_negligible(&self.camera) { 0 } else { 1 };
        let a_pixel = reading_memory(&self.path)
            + self.mask.as_ref().map_or(0, of_mask)
            + of_lens * MEMORY_PER_UNDISTORTED_PIXEL;
        u64::from(self.camera.width) * u64::from(self.camera.height) * a_pixel
    }

    /// Reads the image and the mask, removes the lens distortion, and reduces both to
    /// 1/`downscale` of the size.
    ///
    /// # Errors
    /// If a file is missing or wrong, or the distortion cannot be removed.
    pub fn read(self, downscale: u32) -> Result<View> {
        let photograph = self.read_photograph()?;
        let photograph = self.undistorted(photograph)?;
        let Photograph { camera, image, mask } = match downscale {
            2.. => photograph.downscaled(downscale),
            _ => photograph,
        };
        let mask = mask.map(|(kind, film)| {
            let values = film.pixels.iter().map(|p| p[0]).collect();
            Mask { kind, values }
        });
        Ok(View { name: self.name, path: self.path, camera, image, mask })
    }

    /// Reads the image over black, and its mask: the alpha channel, or else the mask image. An
    /// alpha channel that is at least half opaque everywhere gives way to a mask image.
    fn read_photograph(&self) -> Result<Photograph> {
        let UnreadView { path, camera, .. } = self;
        let (image, alpha) = read_image_of(path, (camera.width, camera.height))?;
        check_size(path, &image, camera, &format!("(from {})", source_of(&self.size_source)))?;
        if let Some(bad) = image.pixels.as_flattened().iter().find(|v| !v.is_finite()) {
            return Err(InputError::new(path, "pixels", bad, "finite numbers"));
        }
        if let Some(bad) = alpha.iter().flatten().find(|a| !(0.0..=1.0).contains(*a)) {
            return Err(InputError::new(path, "alpha", bad, "numbers from 0 to 1"));
        }
        let image = match &alpha {
            Some(alpha) => over_black(image, alpha),
            None => image,
        };
        let is_opaque = |alpha: &Vec<f32>| alpha.iter().all(|a| *a >= HALF);
        let mask = match (alpha, &self.mask) {
            (Some(alpha), mask) if mask.is_none() || !is_opaque(&alpha) => {
                Some((MaskKind::Alpha, Film::grey(image.width, image.height, alpha)))
            }
            (_, Some((kind, mask))) => Some((*kind, read_mask(mask, camera)?)),
            (_, None) => None,
        };
        Ok(Photograph { camera: *camera, image, mask })
    }

    /// The pinhole camera of the photograph without its distortion.
    pub fn pinhole(&self) -> Result<Camera> {
        if self.lens.is_negligible(&self.camera) {
            return Ok(self.camera);
        }
        self.lens.pinhole(&self.camera).ok_or_else(|| {
            let expected = "a lens whose distortion can be removed from most of the image \
                (undistort the images first)";
            InputError::new(&self.path, "distortion", format!("{:?}", self.lens), expected)
        })
    }

    /// The photograph as a pinhole camera would have taken it.
    fn undistorted(&self, photograph: Photograph) -> Result<Photograph> {
        let Photograph { camera, image, mask } = &photograph;
        if self.lens.is_negligible(camera) {
            return Ok(photograph);
        }
        let ideal = self.pinhole()?;
        let resample = |film: &Film| self.lens.undistort(film, camera, &ideal);
        Ok(Photograph {
            image: resample(image),
            mask: mask.as_ref().map(|(kind, mask)| (*kind, resample(mask))),
            camera: ideal,
        })
    }
}

/// The mask in the reduced copies of the masks, `masks_4` for an image in `images_4`; if there is
/// none, the mask itself.
fn copy_of_mask(mask: &Path, image: &Path) -> PathBuf {
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let copy = || {
        let folder = name(image.parent()?)?;
        let (_, factor) = folder.rsplit_once('_')?;
        let masks = mask.parent()?;
        let masks = masks.with_file_name(format!("{}_{factor}", name(masks)?));
        Some(masks.join(mask.file_name()?)).filter(|copy| copy.is_file())
    };
    copy().unwrap_or_else(|| mask.to_owned())
}

impl Photograph {
    /// The photograph at 1/`n` of its width and height, rounded up. A pixel is the mean of n × n
    /// pixels; at the right and lower border, of those that exist.
    fn downscaled(self, n: u32) -> Self {
        let Photograph { camera, image, mask } = self;
        Photograph {
            camera: camera.reduced(n, camera.width.div_ceil(n), camera.height.div_ceil(n)),
            image: image.downscaled(n),
            mask: mask.map(|(kind, mask)| (kind, mask.downscaled(n))),
        }
    }
}

/// The image times its alpha channel.
///
/// The colour of a transparent pixel is undefined in many files; over black it is defined.
fn over_black(image: Film, alpha: &[f32]) -> Film {
    let pixels = image.pixels.iter().zip(alpha).map(|(p, a)| p.map(|c| c * a)).collect();
    Film { pixels, ..image }
}

/// Reads a mask image: white, or opaque, is the object, or a pixel to use.
fn read_mask(path: &Path, camera: &Camera) -> Result<Film> {
    let (mask, alpha) = read_image_of(path, (camera.width, camera.height))?;
    check_size(path, &mask, camera, "(the photograph's size)")?;
    // A mask file holds coverage as display values, so the decoding of `read_image_of` is inverted.
    let shown: Vec<f32> = mask.pixels.iter().map(|p| srgb_encode(p[0]).clamp(0.0, 1.0)).collect();
    // If the mask is in the alpha channel, the colours of the mask file are not used.
    let in_alpha = alpha.filter(|a| a.iter().any(|a| *a < 1.0));
    Ok(Film::grey(mask.width, mask.height, in_alpha.unwrap_or(shown)))
}

/// Refuses an image whose size differs from the camera's.
fn check_size(path: &Path, image: &Film, camera: &Camera, source: &str) -> Result<()> {
    if (image.width, image.height) == (camera.width, camera.height) {
        return Ok(());
    }
    let found = format!("{} x {}", image.width, image.height);
    let expected = format!("{} x {} {source}", camera.width, camera.height);
    Err(InputError::new(path, "size", found, expected))
}
