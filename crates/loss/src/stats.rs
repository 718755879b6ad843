//! Sums over the pixels of an iteration.

/// Sums over the pixels of an iteration.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatchStats {
    /// The number of pixels that the draws stand for.
    pub pixels: u64,
    /// The photometric loss, over the pixels.
    pub photometric: f64,
    /// (|∇f| − 1)², over the points of the eikonal term.
    pub eikonal: f64,
    /// The number of points of the eikonal term.
    pub eikonal_points: u64,
    /// The squared error in display units, over the pixels.
    pub squared_error: f64,
    /// The number of pixels that a silhouette may cross.
    pub edge_pixels: u64,
    /// The term of patches without its weight, over the pixels.
    pub patches: f64,
    /// The number of traced rays.
    pub rays: u64,
}

impl BatchStats {
    /// Adds the sums of other pixels.
    pub fn add(&mut self, o: &BatchStats) {
        self.pixels += o.pixels;
        self.photometric += o.photometric;
        self.eikonal += o.eikonal;
        self.eikonal_points += o.eikonal_points;
        self.squared_error += o.squared_error;
        self.edge_pixels += o.edge_pixels;
        self.patches += o.patches;
        self.rays += o.rays;
    }
}
