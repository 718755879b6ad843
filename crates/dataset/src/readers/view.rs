//! One posed photograph.

use std::path::PathBuf;

use film::Film;
use render::Camera;

use crate::readers::{ALL_USED, Mask, MaskKind};

/// One posed photograph, without lens distortion.
#[derive(Clone, Debug)]
pub struct View {
    /// The image's name in the data set, for messages and pictures.
    pub name: String,
    /// The image's file.
    pub path: PathBuf,
    /// The pinhole camera of the image.
    pub camera: Camera,
    /// The photograph, linear RGB; composited over black if the file has an alpha channel.
    pub image: Film,
    /// The mask: the alpha channel, or else a mask image. `None` if the data set has neither for
    /// this view.
    pub mask: Option<Mask>,
}

impl View {
    /// The coverage of each pixel by the object, in [0, 1], if the mask tells it.
    pub fn coverage(&self) -> Option<&[f32]> {
        self.mask.as_ref().and_then(Mask::coverage)
    }

    /// Whether pixel `i`, row-major, is used: no mask leaves it out.
    pub fn is_used(&self, i: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.is_used(i))
    }

    /// The view at 1/`n` of its size, rounded up; see [`Film::downscaled`]. A pixel of it is used
    /// if the view uses all that it covers.
    ///
    /// # Panics
    /// If `n` is 0.
    #[must_use]
    pub fn downscaled(&self, n: u32) -> Self {
        let image = self.image.downscaled(n);
        let (width, height) = (self.image.width, self.image.height);
        let mask = self.mask.as_ref().map(|mask| {
            let means = |values: &mut dyn Iterator<Item = f32>| {
                let means = Film::grey(width, height, values).downscaled(n);
                means.pixels.into_iter().map(|p| p[0])
            };
            let values = match mask.kind {
                MaskKind::Alpha | MaskKind::Object => {
                    means(&mut mask.values.iter().copied()).collect()
                }
                MaskKind::Used => {
                    let mut used = self.used().map(|used| f32::from(u8::from(used)));
                    means(&mut used).map(|mean| f32::from(u8::from(mean >= ALL_USED))).collect()
                }
            };
            Mask { kind: mask.kind, values }
        });
        let camera = self.camera.reduced(n, image.width, image.height);
        View { name: self.name.clone(), path: self.path.clone(), camera, image, mask }
    }

    /// [`is_used`](Self::is_used) of each pixel, row-major.
    pub fn used(&self) -> impl Iterator<Item = bool> {
        (0..self.image.pixels.len()).map(|i| self.is_used(i))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec2};

    use super::*;

    #[test]
    fn a_smaller_view_uses_the_pixels_whose_parts_are_all_used() {
        let lens = (DVec2::splat(3.0), DVec2::new(1.5, 1.0));
        let view = |kind| View {
            name: "a".to_owned(),
            path: PathBuf::new(),
            camera: Camera::from_pose(3, 2, lens.0, lens.1, DMat4::IDENTITY).unwrap(),
            image: Film::grey(3, 2, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
            // A pixel is used from 0.5 on.
            mask: Some(Mask { kind, values: vec![1.0, 1.0, 0.75, 0.0, 1.0, 0.5] }),
        };
        let whole = view(MaskKind::Used);
        assert!(whole.downscaled(1).used().eq(whole.used()));
        let half = view(MaskKind::Used).downscaled(2);
        assert_eq!(half.used().collect::<Vec<bool>>(), [false, true]);
        assert_eq!(half.image.pixels, [[2.0; 3], [3.5; 3]]);
        let Camera { width, height, focal, .. } = half.camera;
        assert_eq!((width, height, focal), (2, 1, DVec2::splat(1.5)));
        let half = view(MaskKind::Object).downscaled(2);
        assert_eq!(half.coverage(), Some(&[0.75, 0.625][..]));
    }
}
