//! How much a page shows.

/// The amount of work for a page, and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Grid cells of the mesh along the diameter of the bounding sphere.
    pub cells: usize,
    /// The most faces of the mesh.
    pub faces: usize,
    /// The most views with pictures: held-out ones first, then training ones at equal steps.
    pub views: usize,
    /// The largest width and height of a picture, in pixels.
    pub side: u32,
    /// Samples per pixel of rendered views.
    pub spp: u32,
}

impl Detail {
    /// A page of at most some 8 MB.
    pub const FULL: Detail = Detail { cells: 192, faces: 120_000, views: 48, side: 320, spp: 4 };

    /// A page for a fit that goes on: it takes about a second.
    pub const LIVE: Detail = Detail { cells: 80, faces: 20_000, views: 4, side: 160, spp: 1 };
}
