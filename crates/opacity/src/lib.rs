#![doc = include_str!("../README.md")]

mod compositing;
mod points;

pub use compositing::{radiance, value_vjp, weights};
pub use points::{Chord, ChordPoints, INTERVALS, POINTS};
