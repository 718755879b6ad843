//! The machine's peak of fused multiply–adds, and the part of it that every pass of a network
//! reaches: a table on standard error, JSON on standard output.
//!
//! `cargo xtask bench` runs it, and measures whole programs too.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a benchmark")]

mod passes;
mod peak;

use serde::Serialize;

use passes::PassResult;
use peak::Peak;

/// The allocator of the binary, so that the passes allocate as they do there.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[derive(Serialize)]
struct Machine {
    /// Fused multiply–adds on registers only: one core, single precision.
    peak: Peak,
    passes: Vec<PassResult>,
}

fn main() -> serde_json::Result<()> {
    let peak = Peak::measure();
    eprintln!("peak of one core: {:.0} GFLOP/s ({})\n", peak.gflops, peak.instructions);
    eprintln!("| network | pass | M points/s | GFLOP/s | of the peak | two threads over one |");
    eprintln!("|---|---|---|---|---|---|");
    let passes = passes::measure(&peak);
    println!("{}", serde_json::to_string(&Machine { peak, passes })?);
    Ok(())
}
