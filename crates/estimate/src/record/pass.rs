//! How reverse mode combines the coefficients of pixels.

/// The way in which reverse mode combines the coefficients of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pass<R> {
    /// The coefficients of each pixel apart, for derivative images.
    PerPixel,
    /// The coefficients of all pixels together; their pixel numbers have no meaning.
    Sum,
    /// As `Sum`, with a limit on the coefficient of f of one area sample. The unit of the limit is
    /// the coefficient of a silhouette that crosses the whole pixel of the sample.
    ///
    /// The limit adds a bias to the gradient.
    Limited(R),
}
