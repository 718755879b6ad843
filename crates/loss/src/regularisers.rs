//! The regularisers of an objective, one after the other.

use crate::bending::bending;
use crate::drawn::{Drawn, NearPoint};
use crate::eikonal::eikonal;
use crate::objective::Regulariser;
use crate::reversed::Reversed;

/// Adds the regularisers of the objective: `surface` are the points of the surface that this part
/// of the pixels sees.
pub(crate) fn regularise(drawn: &Drawn<'_>, surface: &[NearPoint], out: &mut Reversed) {
    for regulariser in drawn.objective.regularisers {
        match *regulariser {
            Regulariser::Eikonal(weight) => eikonal(drawn, surface, weight, out),
            Regulariser::Bending(weight) => bending(drawn, surface, weight, out),
        }
    }
}
