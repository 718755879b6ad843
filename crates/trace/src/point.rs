//! Values of f along a ray.

/// A value of f along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point<R> {
    /// The distance along the ray.
    pub(crate) t: R,
    pub(crate) f: R,
}
