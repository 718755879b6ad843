//! Kernels on blocks of points, compiled for each instruction set. No other module of the library
//! has `unsafe`.
//!
//! - [`block`]: blocks of points as rows of lanes, and packed weights.
//! - [`portable`]: the kernels for any machine and both precisions.
//! - `x86`: the kernels for AVX-512 and AVX2 in single precision.
//!
//! All kernels add in the same order. All functions below a [`Pass`] are `#[inline(always)]`, so
//! that a pass is compiled as a whole for each instruction set.
#![allow(
    unsafe_code,
    reason = "vector instructions, and calls of functions compiled for instructions that were \
              detected at run time"
)]

mod block;
mod isa;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use block::{HALF, LANES, Row, TILE, pack, padded};
pub(crate) use isa::{Isa, Pass, fma};
pub(crate) use portable::{Portable, multiply_rows, outer_rows, transpose_lanes};

/// Runs a pass with the widest vectors of this machine.
pub(crate) fn dispatch<P: Pass>(pass: P) {
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

/// Runs a pass with every instruction set of this machine, widest vectors first.
#[cfg(test)]
pub(crate) fn dispatch_all<P: Pass>(mut pass: impl FnMut(&'static str) -> P) {
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
