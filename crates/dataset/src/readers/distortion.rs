//! The distortion of all photographs of a data set, in numbers.

use serde::Serialize;

use crate::readers::unread::UnreadView;

/// The difference of photographs from those of pinhole cameras. It is removed when they are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distortion {
    /// The number of views that are resampled.
    pub views: usize,
    /// The number of them with a fisheye lens.
    pub fisheye: usize,
    /// The largest displacement along the border of a photograph of another lens, in pixels of the
    /// whole photograph.
    pub pixels: f64,
}

impl Distortion {
    /// The distortion of all views.
    pub fn of<'a>(views: impl IntoIterator<Item = &'a UnreadView>) -> Self {
        let mut all = Distortion::default();
        for UnreadView { lens, camera, .. } in views {
            if lens.is_negligible(camera) {
                continue;
            }
            all.views += 1;
            if lens.is_fisheye() {
                all.fisheye += 1;
            } else {
                all.pixels = all.pixels.max(lens.displacement(camera));
            }
        }
        all
    }
}
