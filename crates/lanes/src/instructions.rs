//! The instruction sets of a machine, and the passes on them.

#[cfg(target_arch = "x86_64")]
use crate::x86;
use crate::{Pass, Portable};

/// A set of vector instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instructions {
    /// AVX-512 F, DQ, BW and VL, with AVX2 and fused multiply–adds.
    Avx512,
    /// AVX2 with fused multiply–adds.
    Avx2,
    /// No explicit vectors.
    Portable,
}

impl Instructions {
    /// All sets, the widest vectors first.
    pub const ALL: [Self; 3] = [Instructions::Avx512, Instructions::Avx2, Instructions::Portable];

    /// Whether this machine has the instructions.
    pub fn are_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => x86::has_avx512(),
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => x86::has_avx2(),
            #[cfg(not(target_arch = "x86_64"))]
            Instructions::Avx512 | Instructions::Avx2 => false,
            Instructions::Portable => true,
        }
    }

    /// The set with the widest vectors of this machine.
    pub fn widest() -> Self {
        Self::ALL.into_iter().find(|set| set.are_available()).unwrap_or(Instructions::Portable)
    }
}

/// Runs a pass with these instructions, or with portable ones if this machine does not have them.
pub fn dispatch<P: Pass>(instructions: Instructions, pass: P) {
    match instructions {
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx512 if instructions.are_available() => {
            // SAFETY: the instruction sets that `with_avx512` needs were detected.
            unsafe { x86::with_avx512(pass) }
        }
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2 if instructions.are_available() => {
            // SAFETY: the instruction sets that `with_avx2` needs were detected.
            unsafe { x86::with_avx2(pass) }
        }
        _ => pass.run::<Portable>(),
    }
}
