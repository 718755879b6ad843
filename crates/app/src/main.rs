//! The `dsdf` command.

use std::process::ExitCode;

/// Batches of changing sizes come and go with every step of the tracer: what is freed is kept for
/// the next.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(app::cli::run(std::env::args_os()))
}
