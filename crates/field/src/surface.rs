//! Batches of surface points, the input of shaders, and their adjoints.

use crate::real::{Real, Vector3};

/// Surface points with their normals and view directions: all inputs of a shader.
///
/// The three slices have the same length, one element for each point.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBatch<'a, R: Real> {
    /// The points, in world units.
    pub x: &'a [R::Vec3],
    /// The unit normals, pointing out of the solid.
    pub normal: &'a [R::Vec3],
    /// The unit view directions, from the camera to the points.
    pub direction: &'a [R::Vec3],
}

/// Adjoints of a [`SurfaceBatch`]: the derivatives of one scalar by every point, normal and
/// direction.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAdjoint<R: Real> {
    /// Adjoints of the points, per world unit.
    pub x: Vec<R::Vec3>,
    /// Adjoints of the normals.
    pub normal: Vec<R::Vec3>,
    /// Adjoints of the view directions.
    pub direction: Vec<R::Vec3>,
}

impl<'a, R: Real> SurfaceBatch<'a, R> {
    /// The number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether the batch has no points.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// The batch of the points with indices in `range`.
    ///
    /// # Panics
    /// If `range` ends after the last point.
    pub fn range(&self, range: std::ops::Range<usize>) -> SurfaceBatch<'a, R> {
        let SurfaceBatch { x, normal, direction } = *self;
        let (x, normal) = (&x[range.clone()], &normal[range.clone()]);
        SurfaceBatch { x, normal, direction: &direction[range] }
    }
}

impl<R: Real> SurfaceAdjoint<R> {
    /// Zero adjoints for a batch of `points` points.
    pub fn zeros(points: usize) -> Self {
        let zero = || vec![R::Vec3::zero(); points];
        SurfaceAdjoint { x: zero(), normal: zero(), direction: zero() }
    }

    /// Whether all adjoints are zero.
    pub fn is_zero(&self) -> bool {
        let all = [&self.x, &self.normal, &self.direction];
        all.into_iter().flatten().all(|v| *v == R::Vec3::zero())
    }
}
