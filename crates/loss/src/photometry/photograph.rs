//! A photograph at one size, and draws of its pixels.

use dataset::{ALL_USED, View};
use film::Film;
use glam::{DVec2, Vec3};
use render::Sample;

use crate::photometry::loss::Target;
use crate::photometry::margin::near;
use crate::photometry::masks::MaskUse;

/// The photograph of a view at one size.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Its image.
    pub image: Film,
    /// The coverage of each pixel by the object, if the fit uses it. The image is over black then.
    pub coverage: Option<Film>,
    /// The share of each pixel that is used, if the fit leaves some out.
    used: Option<Film>,
}

impl Photograph {
    /// The photograph of a view, with the part of its mask that `masks` asks for.
    pub fn new(view: &View, masks: MaskUse) -> Self {
        let (width, height) = (view.image.width, view.image.height);
        let coverage = view.coverage().filter(|_| masks == MaskUse::Coverage);
        let used = || view.used().map(|used| f32::from(u8::from(used)));
        Photograph {
            image: view.image.clone(),
            coverage: coverage.map(|values| Film::grey(width, height, values.iter().copied())),
            used: (masks == MaskUse::LeaveOut).then(|| Film::grey(width, height, used())),
        }
    }

    /// The photograph at 1/`n` of its size; see [`Film::downscaled`].
    ///
    /// # Panics
    /// If `n` is 0.
    #[must_use]
    pub(crate) fn downscaled(&self, n: u32) -> Self {
        let downscaled = |film: &Film| film.downscaled(n);
        Photograph {
            image: downscaled(&self.image),
            coverage: self.coverage.as_ref().map(downscaled),
            used: self.used.as_ref().map(downscaled),
        }
    }

    /// The width and the height.
    pub fn size(&self) -> [u32; 2] {
        [self.image.width, self.image.height]
    }

    /// The radiance of pixel (x, y) in front of `behind`. A photograph without coverage shows its
    /// own background.
    pub fn over(&self, behind: Vec3, x: u32, y: u32) -> [f32; 3] {
        let radiance = self.image.at(x, y);
        let Some(coverage) = &self.coverage else { return radiance };
        (Vec3::from(radiance) + behind * (1.0 - coverage.at(x, y)[0])).to_array()
    }

    /// The target of a drawn pixel of this photograph, in front of `behind`.
    pub fn target(&self, behind: Vec3, draw: &Draw) -> Target {
        let seen = |x, y| self.over(behind, x, y);
        Target::of(self.size(), seen, draw.x.into(), draw.y.into())
    }

    /// Whether all pixels in a square with this margin around pixel (x, y) are used, as far as they
    /// are in the photograph.
    pub fn is_used_around(&self, x: u32, y: u32, margin: u32) -> bool {
        let [width, height] = self.size();
        self.used.is_none()
            || near(y, margin, height).all(|y| near(x, margin, width).all(|x| self.is_used(x, y)))
    }

    /// Whether pixel (x, y) is used, all of it.
    pub fn is_used(&self, x: u32, y: u32) -> bool {
        self.used.as_ref().is_none_or(|used| used.at(x, y)[0] >= ALL_USED)
    }
}

/// A draw of an iteration: a pixel of a view, which can stand for others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// The index of the view.
    pub view: u32,
    /// The column.
    pub x: u16,
    /// The row.
    pub y: u16,
    /// The number of pixels that this draw stands for.
    pub count: u16,
}

impl Draw {
    /// The film sample in the middle of the pixel.
    pub fn center(&self) -> Sample {
        let u = DVec2::new(f64::from(self.x) + 0.5, f64::from(self.y) + 0.5);
        Sample { camera: self.view as usize, u }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Photograph {
        /// A photograph without a mask.
        pub(crate) fn of_image(image: Film) -> Self {
            Photograph { image, coverage: None, used: None }
        }
    }

    #[test]
    fn a_photograph_with_coverage_is_seen_in_front_of_any_colour() {
        let grey = |value| Film::grey(1, 1, [value]);
        let mut photograph = Photograph { image: grey(0.1), coverage: Some(grey(0.5)), used: None };
        assert_eq!(photograph.over(Vec3::new(0.0, 0.5, 1.0), 0, 0), [0.1, 0.35, 0.6]);
        photograph.coverage = None;
        assert_eq!(photograph.over(Vec3::ONE, 0, 0), [0.1; 3]);
    }
}
