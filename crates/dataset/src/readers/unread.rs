//! A view whose image is not read yet, and the steps from its files to a [`View`].

use std::path::{Path, PathBuf};

use glam::DVec2;

use crate::readers::lens::Lens;
use crate::readers::mask::MaskFile;
use crate::readers::{Mask, MaskKind, View};
use files::InputError;
use film::{Film, StoredImage};
use film::{block_row, image_size, read_stored_image_of, reading_memory};
use rayon::prelude::*;
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// A view whose image is not read yet.
#[derive(Debug)]
pub struct UnreadView {
    pub(crate) name: String,
    /// The image file.
    pub(crate) path: PathBuf,
    /// A separate mask image, if the data set has one.
    pub(crate) mask: Option<MaskFile>,
    /// The pinhole part of the camera that took the photograph.
    pub(crate) camera: Camera,
    /// Distortion and skew, to be removed from the photograph.
    pub(crate) lens: Lens,
    /// The file or the record that states the camera's size; without one it is that of the image.
    pub(crate) size_source: Option<String>,
    /// The size in the camera file, if the image is a reduced copy of another size.
    pub(crate) full_size: Option<[u32; 2]>,
    /// The uniform scale that was divided out of the axes of its pose.
    pub(crate) pose_scale: f64,
}

/// A photograph and its mask as their files store them.
struct Photograph {
    image: StoredImage,
    mask: Option<(MaskKind, StoredMask)>,
}

/// The place of a mask's numbers.
enum StoredMask {
    /// The alpha channel of the photograph.
    AlphaOfImage,
    /// The alpha channel of a mask image.
    Alpha(StoredImage),
    /// The display values of a mask image.
    Shown(StoredImage),
    /// The numbers of a mask image of another size than the photograph, brought to its size.
    Resized(Film),
}

/// A pixel with less alpha is cut out.
const HALF: f32 = 0.5;

/// Bytes of memory for each pixel of a photograph whose distortion is removed: its values in single
/// precision.
const MEMORY_PER_DISTORTED_PIXEL: u64 = 16;

/// Bytes of memory for each pixel of the view that is read: an image in single precision and a
/// mask.
const MEMORY_PER_READ_PIXEL: u64 = 16;

/// The least and the largest focal length, in parts of the larger side of the photograph: fields of
/// view of 180 degrees and of a thousandth of a degree.
const FOCAL: [f64; 2] = [1e-3, 1e5];

/// The largest coordinate of the principal point, in the same parts: a photograph can be a small
/// part of a larger one.
const MOST_OFF_FILM: f64 = 1e3;

/// Programs round the sides of a reduced image to whole pixels, down or up.
const ROUNDING: f64 = 1.5;

/// A side that differs by a pixel was cropped, not rounded: the limit of images that were resized.
const RESIZED: f64 = 1.0 - 1e-9;

/// The remedy for images that do not have the shape of their cameras.
const RESHAPED: &str = "an image that was cropped needs the uncropped one, or new poses";

fn to_vector((width, height): (u32, u32)) -> DVec2 {
    DVec2::new(f64::from(width), f64::from(height))
}

/// Whether an image of `size` has the aspect ratio of `full`, up to this many pixels.
fn is_same_shape(size: (u32, u32), full: (u32, u32), rounding: f64) -> bool {
    let (size, full) = (to_vector(size), to_vector(full));
    let scale = (size / full).max_element();
    (full * scale - size).max_element() <= rounding * scale.max(1.0)
}

/// A view's [`UnreadView::size_source`] in messages.
fn source_of(size: &Option<String>) -> &str {
    size.as_deref().unwrap_or("the image")
}

impl UnreadView {
    /// A view without a mask, whose camera has the size of the image.
    pub(crate) fn of_image(name: String, path: PathBuf, camera: Camera, lens: Lens) -> Self {
        UnreadView {
            name,
            path,
            mask: None,
            camera,
            lens,
            size_source: None,
            full_size: None,
            pose_scale: 1.0,
        }
    }

    /// The same view of a camera whose pose had this scale.
    pub(crate) fn with_pose_scale(self, pose_scale: f64) -> Self {
        UnreadView { pose_scale, ..self }
    }

    /// The image's name in the data set.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The pinhole part of the camera that took the photograph.
    pub fn camera(&self) -> &Camera {
        &self.camera
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
    pub(crate) fn of_reduced_image(self) -> Result<Self> {
        self.of_image_within(ROUNDING)
    }

    /// See [`of_reduced_image`](Self::of_reduced_image); the aspect ratio is the same up to this many
    /// pixels.
    fn of_image_within(mut self, rounding: f64) -> Result<Self> {
        let camera = &mut self.camera;
        let (width, height) = image_size(&self.path)?;
        let full = (camera.width, camera.height);
        let fits = |size: &(u32, u32)| is_same_shape(*size, full, rounding);
        // An image may be turned by its EXIF orientation.
        let size = [(width, height), (height, width)].into_iter().find(fits).ok_or_else(|| {
            let [w, h] = [camera.width, camera.height];
            let expected = format!(
                "the aspect ratio of {w} x {h} (from {}): {RESHAPED}",
                source_of(&self.size_source)
            );
            InputError::new(&self.path, "size", format!("{width} x {height}"), expected)
        })?;
        if size != (camera.width, camera.height) {
            let scale = to_vector(size) / to_vector(full);
            self.full_size = Some([camera.width, camera.height]);
            (camera.width, camera.height) = size;
            camera.focal *= scale;
            camera.principal *= scale;
            self.lens.skew *= scale.x;
        }
        Ok(self)
    }

    /// The view with the size of its image, if the camera file states another one of the same
    /// aspect ratio.
    ///
    /// # Errors
    /// If the image has another aspect ratio.
    pub(crate) fn of_resized_image(self) -> Result<Self> {
        let is_stated = self.size_source.is_some() && self.full_size.is_none();
        // The size of an NPY file is known once all of it is read.
        if !is_stated || files::extension(&self.path) == "npy" {
            return Ok(self);
        }
        // An image that cannot be read is refused with the reason when it is read.
        let Ok((width, height)) = image_size(&self.path) else { return Ok(self) };
        let Camera { width: w, height: h, .. } = self.camera;
        // One that is turned by its EXIF orientation has the camera's size once it is read.
        if [(w, h), (h, w)].contains(&(width, height)) {
            return Ok(self);
        }
        self.of_image_within(RESIZED)
    }

    /// The size of the mask file, if it is another one than that of the photograph.
    pub(crate) fn other_size_of_mask(&self) -> Option<[u32; 2]> {
        let (width, height) = image_size(&self.mask.as_ref()?.path).ok()?;
        let size = [width, height];
        let [w, h] = self.size();
        (size != [w, h] && size != [h, w]).then_some(size)
    }

    /// An estimate of the memory for [`read`](Self::read), in bytes.
    pub fn reading_memory(&self, downscale: u32) -> u64 {
        let pixels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
        let of_mask = |mask: &MaskFile| reading_memory(&mask.path);
        let of_files = reading_memory(&self.path) + self.mask.as_ref().map_or(0, of_mask);
        let of_lens = if self.lens.is_negligible(&self.camera) { 0 } else { 1 };
        let small = self.size().map(|side| side.div_ceil(downscale));
        pixels(self.size()) * (of_files + of_lens * MEMORY_PER_DISTORTED_PIXEL)
            + pixels(small) * MEMORY_PER_READ_PIXEL
    }

    /// Reads the image and the mask, removes the lens distortion, and reduces both to
    /// 1/`downscale` of the size.
    ///
    /// All of it is done for one row of the result after the other, so that a photograph without
    /// distortion needs no film of the full size.
    ///
    /// # Errors
    /// If a file is missing or wrong, or the distortion cannot be removed.
    ///
    /// # Panics
    /// If `downscale` is 0.
    pub fn read(self, downscale: u32) -> Result<View> {
        let Photograph { image, mask } = self.read_photograph()?;
        let camera = self.pinhole()?;
        // The places of a distorted photograph are in no order, and each has four pixels.
        let is_pinhole = self.lens.is_negligible(&self.camera);
        let image = if is_pinhole { image } else { image.decoded() };
        // The colour of a transparent pixel is undefined in many files; over black it is defined.
        let has_alpha = image.has_alpha();
        let at = |x, y| match has_alpha {
            true => image.at(x, y).map(|c| c * image.alpha_at(x, y)),
            false => image.at(x, y),
        };
        let row = |y, row: &mut [[f32; 3]]| {
            image.write_row(y, row);
            if has_alpha {
                let alpha = (0..).map(|x| image.alpha_at(x, y));
                row.iter_mut().zip(alpha).for_each(|(p, a)| *p = p.map(|c| c * a));
            }
        };
        let pixels = self.reduced(&camera, downscale, at, row);
        let mask = mask.map(|(kind, mask)| {
            let number = |x, y| match &mask {
                StoredMask::AlphaOfImage => image.alpha_at(x, y),
                StoredMask::Alpha(mask) => mask.alpha_at(x, y),
                // A mask file holds coverage as display values.
                StoredMask::Shown(mask) => mask.display_at(x, y).clamp(0.0, 1.0),
                StoredMask::Resized(mask) => mask.at(x, y)[0].clamp(0.0, 1.0),
            };
            let row = |y, row: &mut [[f32; 1]]| {
                row.iter_mut().zip(0..).for_each(|(out, x)| *out = [number(x, y)]);
            };
            let values = self.reduced(&camera, downscale, |x, y| [number(x, y)], row);
            Mask { kind, values: values.into_flattened() }
        });
        let [width, height] = self.size().map(|side| side.div_ceil(downscale));
        let camera = if downscale > 1 { camera.reduced(downscale, width, height) } else { camera };
        let image = Film { width, height, pixels };
        Ok(View { name: self.name, path: self.path, camera, image, mask })
    }

    /// The pixels of the pinhole camera `ideal` at 1/`n` of its size, row by row. `at` gives those
    /// of the photograph with its distortion, and `row` writes a row of them.
    fn reduced<const C: usize>(
        &self,
        ideal: &Camera,
        n: u32,
        at: impl Fn(u32, u32) -> [f32; C] + Sync,
        row: impl Fn(u32, &mut [[f32; C]]) + Sync,
    ) -> Vec<[f32; C]> {
        let size = self.size();
        let rows = 0..size[1].div_ceil(n);
        if self.lens.is_negligible(&self.camera) {
            return rows.flat_map(|y| block_row(size, n, y, &row)).collect();
        }
        let cameras = [&self.camera, ideal];
        let undistorted = |y, row: &mut [[f32; C]]| {
            let pixel = |x| self.lens.undistorted(size, &at, cameras, [x, y]);
            row.iter_mut().zip(0..).for_each(|(out, x)| *out = pixel(x));
        };
        rows.into_par_iter().flat_map_iter(|y| block_row(size, n, y, undistorted)).collect()
    }

    /// Reads the image and its mask: the alpha channel, or else the mask image. An alpha channel
    /// that is at least half opaque everywhere gives way to a mask image.
    fn read_photograph(&self) -> Result<Photograph> {
        let UnreadView { path, camera, .. } = self;
        let image = read_stored_image_of(path, (camera.width, camera.height))?;
        check_size(path, &image, camera, &format!("(from {})", source_of(&self.size_source)))?;
        if let Some(bad) = image.first_non_finite() {
            return Err(InputError::new(path, "pixels", bad, "finite numbers"));
        }
        let alpha = || image.alpha().into_iter().flatten();
        if let Some(bad) = alpha().find(|a| !(0.0..=1.0).contains(a)) {
            return Err(InputError::new(path, "alpha", bad, "numbers from 0 to 1"));
        }
        let mask = match &self.mask {
            // Without an alpha channel, none is less than half opaque.
            Some(mask) if alpha().all(|a| a >= HALF) => {
                Some((mask.kind, read_mask(&mask.path, camera)?))
            }
            _ => image.has_alpha().then_some((MaskKind::Alpha, StoredMask::AlphaOfImage)),
        };
        Ok(Photograph { image, mask })
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
}

/// Reads a mask image: white, or opaque, is the object, or a pixel to use.
fn read_mask(path: &Path, camera: &Camera) -> Result<StoredMask> {
    let mask = read_stored_image_of(path, (camera.width, camera.height))?;
    // If the mask is in the alpha channel, the colours of the mask file are not used.
    let is_in_alpha = mask.alpha().into_iter().flatten().any(|a| a < 1.0);
    let [width, height] = mask.size();
    if (width, height) == (camera.width, camera.height) {
        return Ok(if is_in_alpha { StoredMask::Alpha(mask) } else { StoredMask::Shown(mask) });
    }
    if !is_same_shape((width, height), (camera.width, camera.height), 1.0) {
        check_size(path, &mask, camera, "(the photograph's size), or its aspect ratio")?;
    }
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let number = |(x, y)| if is_in_alpha { mask.alpha_at(x, y) } else { mask.display_at(x, y) };
    let numbers = Film::grey(width, height, pixels.map(number));
    Ok(StoredMask::Resized(numbers.resized(camera.width, camera.height)))
}

/// Refuses an image whose size differs from the camera's.
fn check_size(path: &Path, image: &StoredImage, camera: &Camera, source: &str) -> Result<()> {
    let [width, height] = image.size();
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    let found = format!("{width} x {height}");
    let is_turned = (height, width) == (camera.width, camera.height);
    let remedy = if is_turned {
        ": turn the image, or exchange width and height in the camera file"
    } else {
        ""
    };
    let expected = format!("{} x {} {source}{remedy}", camera.width, camera.height);
    Err(InputError::new(path, "size", found, expected))
}
