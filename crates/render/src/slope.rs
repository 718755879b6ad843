//! The slope of a scene's field, for the first steps of rays.

use field::{Real, slope};

use crate::scene::{Scene, Tracing};

impl<R: Real> Scene<'_, R> {
    /// The scene with a relaxation that suits the [`slope`] of its field, taken at `points` points:
    /// 1/slope times that of its options.
    ///
    /// Rays start with the slope 1/relaxation. A ray that starts with less than the slope of the
    /// field can step over a part of the solid before it sees the slope.
    pub fn with_slope_of_field(self, points: u64) -> Self {
        let bounds = self.bounding_ball();
        let slope = slope(self.field, &self.field.bounds().unwrap_or(bounds), points);
        let mut options = self.tracing.options;
        options.relaxation /= slope;
        Scene { tracing: Tracing { options, ..self.tracing }, ..self }
    }
}
