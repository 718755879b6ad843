//! Choice of the instruction set at run time: the one place of the crate that needs `unsafe`.
#![allow(unsafe_code, reason = "calling a function compiled for instructions that were checked for at run time")]

/// A computation over a batch, generic over whether fused multiply–add is an instruction.
///
/// Implementations mark `run` `#[inline(always)]`, so that all of it is compiled for the instruction set.
pub(crate) trait Pass {
    /// Does it.
    fn run<const FMA: bool>(self);
}

/// Runs a pass with the widest instructions this machine has.
pub(crate) fn dispatch<P: Pass>(pass: P) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the instructions that the function is compiled for are present.
            unsafe { with_avx2(pass) };
            return;
        }
    }
    #[cfg(target_arch = "aarch64")]
    {
        // Fused multiply–add is part of the base instruction set.
        pass.run::<true>();
    }
    #[cfg(not(target_arch = "aarch64"))]
    pass.run::<false>();
}

/// # Safety
/// The machine must have AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn with_avx2<P: Pass>(pass: P) {
    pass.run::<true>();
}
