#![doc = include_str!("../README.md")]
#![allow(
    clippy::needless_range_loop,
    reason = "kernels index several arrays by the same lane or row"
)]
#![allow(
    unsafe_code,
    reason = "vector instructions, and calls of functions compiled for instructions that were \
              detected at run time"
)]

mod block;
mod group;
mod instructions;
mod isa;
mod math;
mod parts;
mod plain;
mod portable;
mod single;
mod table;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use block::{FEW_POINTS, HALF, LANES, Row, Softplus, TILE, pack, pack_columns, padded};
pub use group::{GROUP, Group};
pub use instructions::{Instructions, dispatch};
pub use isa::{Isa, Pass, fma};
pub use math::Lane;
pub use parts::{multiply, multiply_few, outer};
pub use plain::Plain;
pub use portable::Portable;
pub use table::{Sums, TableRows};
