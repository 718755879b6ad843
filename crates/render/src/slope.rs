//! The slope of a scene's field, for the first steps of rays.

use field::{Real, Vector3, slope_of, slope_places};
use rayon::prelude::*;

use crate::scene::{Scene, Tracing};

/// Points that a thread takes at a time.
const CHUNK: usize = 32;

impl<R: Real> Scene<'_, R> {
    /// The scene with a relaxation that suits the [`slope`](field::slope) of its field, taken at
    /// `points` points: 1/slope times that of its options.
    ///
    /// Rays start with the slope 1/relaxation. A ray that starts with less than the slope of the
    /// field can step over a part of the solid before it sees the slope.
    pub fn with_slope_of_field(self, points: u64) -> Self {
        if self.field.is_lipschitz() {
            return self;
        }
        let ball = self.field.bounds().unwrap_or(self.bounding_ball());
        let x = slope_places(&ball, points);
        let mut gradient = vec![R::Vec3::zero(); x.len()];
        x.par_chunks(CHUNK).zip(gradient.par_chunks_mut(CHUNK)).for_each(|(x, gradient)| {
            self.field.value_gradient(x, &mut vec![R::zero(); x.len()], gradient);
        });
        let slope = slope_of::<R>(&gradient);
        let mut options = self.tracing.options;
        options.relaxation /= slope;
        Scene { tracing: Tracing { options, ..self.tracing }, ..self }
    }
}
