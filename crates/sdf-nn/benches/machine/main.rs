//! What the machine can do, and what of it every pass of the network uses: a table on standard
//! error, JSON on standard output. `cargo xtask bench` runs it and sets whole programs beside it.

mod passes;
mod peak;

use serde::Serialize;

use passes::PassResult;
use peak::Peak;

/// That of the binary: what is measured here allocates as it does there.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[derive(Serialize)]
struct Machine {
    /// Fused multiply–adds in registers alone, one core, single precision.
    peak: Peak,
    passes: Vec<PassResult>,
}

fn main() -> serde_json::Result<()> {
    let peak = Peak::measure();
    eprintln!("{:.0} GFLOP/s at most on one core ({})\n", peak.gflops, peak.instructions);
    eprintln!("| network | pass | M points/s | GFLOP/s | of the peak | two threads over one |");
    eprintln!("|---|---|---|---|---|---|");
    let passes = passes::measure(&peak);
    println!("{}", serde_json::to_string(&Machine { peak, passes })?);
    Ok(())
}
