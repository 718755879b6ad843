//! Batches of surface points, as shaders take them.

use crate::{Real, Vector3};

/// Surface points with all that radiance depends on; one element of every slice a point.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBatch<'a, R: Real> {
    /// The points, world units.
    pub x: &'a [R::Vec3],
    /// The unit normals.
    pub normal: &'a [R::Vec3],
    /// The unit view directions, from the camera to the points.
    pub direction: &'a [R::Vec3],
}

/// Adjoints of a [`SurfaceBatch`]: derivatives of a scalar by the points, normals and directions.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAdjoint<R: Real> {
    /// By the points, per world unit.
    pub x: Vec<R::Vec3>,
    /// By the normals.
    pub normal: Vec<R::Vec3>,
    /// By the view directions.
    pub direction: Vec<R::Vec3>,
}

impl<'a, R: Real> SurfaceBatch<'a, R> {
    /// The number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// The points of a range.
    pub fn range(&self, range: std::ops::Range<usize>) -> SurfaceBatch<'a, R> {
        let SurfaceBatch { x, normal, direction } = *self;
        let (x, normal) = (&x[range.clone()], &normal[range.clone()]);
        SurfaceBatch { x, normal, direction: &direction[range] }
    }
}

impl<R: Real> SurfaceAdjoint<R> {
    /// Zeros for `points` points.
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
