//! The opacity of a soft surface along rays, and its reverse mode by the values of the field.

mod compositing;
mod points;

pub use compositing::{radiance, value_vjp, weights};
pub use points::{Chord, ChordPoints, INTERVALS, POINTS};
