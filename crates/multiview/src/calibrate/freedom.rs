//! The parameters of cameras that are corrected.

use std::ops::Range;

/// Parameters of the pose of a view: a rotation vector, then a shift of the eye.
pub(crate) const OF_POSE: usize = 6;

/// Parameters of a lens: the logarithm of the focal length, the principal point, k₁ and k₂.
pub(crate) const OF_LENS: usize = 5;

/// The parameters that are corrected. The others stay as given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Freedom {
    /// The rotation and the position of every view.
    pub poses: bool,
    /// The focal length of every lens: one factor for both axes.
    pub focal: bool,
    /// The principal point and the radial distortion of every lens.
    pub lens: bool,
}

impl Freedom {
    /// Nothing.
    pub const NONE: Freedom = Freedom { poses: false, focal: false, lens: false };

    /// Poses alone.
    pub const POSES: Freedom = Freedom { poses: true, focal: false, lens: false };

    /// The positions of the free parameters among those of a lens.
    pub(crate) fn of_lens(self) -> impl Iterator<Item = usize> {
        let range = |on: bool, range: Range<usize>| if on { range } else { 0..0 };
        range(self.focal, 0..1).chain(range(self.lens, 1..OF_LENS))
    }
}
