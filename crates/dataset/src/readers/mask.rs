//! Masks of views, and their meanings.

use std::path::PathBuf;

/// The mask of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// The meaning of the numbers.
    pub kind: MaskKind,
    /// A number in [0, 1] for each pixel, row-major.
    pub values: Vec<f32>,
}

/// The meaning of a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskKind {
    /// Coverage by the object, from an alpha channel. The image is over black.
    Alpha,
    /// Coverage by the object, from a mask image. The image shows the background too.
    Object,
    /// 1 for pixels to use and 0 for pixels to leave out, as the masks of nerfstudio and COLMAP.
    Used,
}

/// The mean of a mask of used pixels from which all of them count as used: 1, less rounding.
pub const ALL_USED: f32 = 0.999;

/// Pixels of a [`MaskKind::Used`] mask below this are left out.
const LEAST_USED: f32 = 0.5;

impl Mask {
    /// The coverage of each pixel by the object; `None` if the mask tells which pixels to use.
    pub fn coverage(&self) -> Option<&[f32]> {
        (self.kind != MaskKind::Used).then_some(&self.values[..])
    }

    /// Whether pixel `i`, row-major, is used. A mask of the object leaves none out.
    pub fn is_used(&self, i: usize) -> bool {
        self.kind != MaskKind::Used || self.values[i] >= LEAST_USED
    }
}

/// A mask file of a view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MaskFile {
    pub(crate) kind: MaskKind,
    pub(crate) path: PathBuf,
    /// White leaves pixels out, as in the `dynamic_mask_*` of instant-ngp, unless all of it is in
    /// the middle of the photographs.
    pub(crate) is_dynamic: bool,
}
