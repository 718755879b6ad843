//! A data set of renders, taken apart into the object and its coverage.

use std::path::{Path, PathBuf};

use dataset::{Dataset, LoadOptions, View, load};
use files::InputError;
use film::srgb_encode;

/// The largest difference between uncovered pixels, in display space (sRGB in [0, 1]): two steps of
/// 8 bits.
const MOST_DIFFERENCE: f32 = 2.0 / 255.0;

/// The share of the uncovered pixels that must agree. A pixel whose coverage the mask rounds to 0
/// can show a little of the object.
const AGREEING: f64 = 0.99;

/// Renders with masks before one colour.
pub(super) struct Source {
    /// The views.
    pub(super) dataset: Dataset,
    /// The folder of the camera file.
    pub(super) folder: PathBuf,
    /// The colour of the uncovered pixels, linear RGB.
    background: [f32; 3],
}

/// A view taken apart; the pixels are in the order of the film.
pub(super) struct Layers {
    /// Width in pixels.
    pub(super) width: u32,
    /// Height in pixels.
    pub(super) height: u32,
    /// The light of the object alone, linear RGB: its radiance times its coverage.
    pub(super) object: Vec<[f32; 3]>,
    /// Coverage by the object, 0 to 1 in steps of 1/255: that of the mask that is written.
    pub(super) coverage: Vec<f32>,
}

impl Source {
    /// Reads a data set.
    ///
    /// # Errors
    /// An [`InputError`] if it cannot be read, if a view has no mask, or if the uncovered pixels
    /// have several colours.
    pub(super) fn load(path: &Path) -> Result<Self, InputError> {
        let dataset = load(path, &LoadOptions::default())?;
        let folder = if path.is_file() { path.parent().unwrap_or(path) } else { path }.to_owned();
        let background = background(&dataset)?;
        Ok(Source { dataset, folder, background })
    }

    /// The training views and the held-out views with the names of their sets, in this order.
    /// Empty sets are left out.
    pub(super) fn sets(&self) -> Vec<(&'static str, &[View])> {
        let sets = [("train", &self.dataset.train[..]), ("test", &self.dataset.test[..])];
        sets.into_iter().filter(|(_, views)| !views.is_empty()).collect()
    }

    /// Takes a view of this data set apart.
    pub(super) fn layers(&self, view: &View) -> Layers {
        let coverage: Vec<f32> =
            coverage(view).iter().map(|a| (255.0 * a).round() / 255.0).collect();
        let of_pixel = |(p, a): (&[f32; 3], &f32)| {
            std::array::from_fn(|c| (p[c] - (1.0 - a) * self.background[c]).max(0.0))
        };
        let object = view.image.pixels.iter().zip(&coverage).map(of_pixel).collect();
        Layers { width: view.image.width, height: view.image.height, object, coverage }
    }
}

/// The coverage of each pixel; empty without a mask.
fn coverage(view: &View) -> &[f32] {
    view.coverage().unwrap_or_default()
}

/// The one colour of all pixels with coverage 0, linear RGB.
fn background(dataset: &Dataset) -> Result<[f32; 3], InputError> {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    if let Some(view) = views.iter().find(|view| view.mask.is_none()) {
        let expected = "a mask image or an alpha channel";
        return Err(InputError::new(&view.path, "mask", "none", expected));
    }
    let mut pixels: Vec<[f32; 3]> = Vec::new();
    for view in views {
        let all = view.image.pixels.iter().zip(coverage(view));
        pixels.extend(all.filter(|(_, a)| **a == 0.0).map(|(p, _)| *p));
    }
    if pixels.is_empty() {
        let expected = "pixels that the object does not cover";
        return Err(InputError::new(&dataset.path, "masks", "none with coverage 0", expected));
    }
    let color = [0, 1, 2].map(|c| {
        let mut values: Vec<f32> = pixels.iter().map(|p| p[c]).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    });
    let agrees = |p: &&[f32; 3]| {
        (0..3).all(|c| (srgb_encode(p[c]) - srgb_encode(color[c])).abs() < MOST_DIFFERENCE)
    };
    let share = pixels.iter().filter(agrees).count() as f64 / pixels.len() as f64;
    if share < AGREEING {
        let found = format!("only {:.0} % of the uncovered pixels of one colour", 100.0 * share);
        let expected = "renders before one colour";
        return Err(InputError::new(&dataset.path, "background", found, expected));
    }
    Ok(color)
}
