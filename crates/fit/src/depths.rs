//! Depth maps of the photographs, which guide the soft surface.

use multiview::stereo::{DepthMap, Guide};

/// The share of the pixels that must have a known depth. Without depths nothing tells a wrong
/// surface from one whose colour is not learned yet, so nothing is carved.
const LEAST_KNOWN: f64 = 0.02;

/// The depth maps of the training views.
#[derive(Clone, Debug)]
pub(crate) struct Depths {
    /// The maps; none if too little is known.
    maps: Vec<DepthMap>,
    /// The level of the pyramid that was searched.
    level: usize,
    /// The share of the pixels with a known depth.
    known: f64,
}

impl Depths {
    /// No depths.
    pub(crate) const NONE: Self = Depths { maps: Vec::new(), level: 0, known: 0.0 };

    /// These maps of a level of the pyramid; [`NONE`](Self::NONE) if they know too little.
    pub(crate) fn new(maps: Vec<DepthMap>, level: usize) -> Self {
        let known = maps.iter().map(DepthMap::known).sum::<f64>() / maps.len().max(1) as f64;
        if known < LEAST_KNOWN { Self::NONE } else { Depths { maps, level, known } }
    }

    /// The depths that guide an iteration on a level of the pyramid.
    pub(crate) fn guide(&self, level: usize) -> Option<Guide<'_>> {
        let Depths { maps, level: own, .. } = self;
        let scale = 2f64.powi(level as i32 - *own as i32);
        (!maps.is_empty()).then_some(Guide { maps, scale })
    }

    /// The share of the pixels with a known depth; 0 if too little is known to use it.
    pub(crate) fn known(&self) -> f64 {
        self.known
    }
}
