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
mod isa;
mod math;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use block::{FEW, HALF, LANES, Row, TILE, pack, pack_columns, padded};
pub use isa::{Isa, Pass, fma};
pub use math::Lane;
pub use portable::{Portable, multiply_few, multiply_rows, outer_rows, transpose_lanes};

/// Runs a pass with the widest vectors of this machine.
pub fn dispatch<P: Pass>(pass: P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: `has_avx512` detected every instruction set that `with_avx512` needs.
            unsafe { x86::with_avx512(pass) };
            return;
        }
        if x86::has_avx2() {
            // SAFETY: `has_avx2` detected every instruction set that `with_avx2` needs.
            unsafe { x86::with_avx2(pass) };
            return;
        }
    }
    pass.run::<Portable>();
}

/// Runs a pass with every instruction set of this machine, widest vectors first. `pass` makes it
/// from the name of the instruction set: a test compares their results.
pub fn dispatch_all<P: Pass>(mut pass: impl FnMut(&'static str) -> P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: `has_avx512` detected every instruction set that `with_avx512` needs.
            unsafe { x86::with_avx512(pass("AVX-512")) };
        }
        if x86::has_avx2() {
            // SAFETY: `has_avx2` detected every instruction set that `with_avx2` needs.
            unsafe { x86::with_avx2(pass("AVX2")) };
        }
    }
    pass("portable").run::<Portable>();
}
