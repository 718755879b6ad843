//! A lattice of a scene's field, where it saves evaluations.

use field::Real;
use rayon::prelude::*;
use trace::Lattice;

use crate::scene::Scene;

/// Rays for which a lattice is made, at least: it has 22,233 nodes, and saves each ray some six
/// evaluations.
const LEAST_RAYS: u64 = 16_384;

/// Nodes that a thread evaluates at a time.
const CHUNK: usize = 1024;

impl<R: Real> Scene<'_, R> {
    /// A lattice of the field for so many rays; `None` if it would save no time. The bits do not
    /// depend on the number of threads.
    ///
    /// A field that is known to be a distance gets none: it is a shape, which takes less time than
    /// a step through a lattice.
    pub fn lattice_for(&self, rays: u64) -> Option<Lattice<R>> {
        if self.field.is_lipschitz() || rays < LEAST_RAYS {
            return None;
        }
        let ball = self.bounding_ball();
        let values = |x: &[R::Vec3]| {
            let mut f = vec![R::zero(); x.len()];
            self.field.value(x, &mut f);
            f
        };
        let places = Lattice::<R>::places(&ball);
        let values: Vec<R> = places.par_chunks(CHUNK).flat_map_iter(values).collect();
        // A NaN has a message that names a ray: rays find it without a lattice.
        values.iter().all(|f| f.is_finite()).then(|| Lattice::of_values(&ball, &values))
    }
}
