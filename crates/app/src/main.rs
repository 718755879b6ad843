//! The program `dsdf`.

use std::process::ExitCode;

/// Every step of the tracer allocates and frees batches of another size. Mimalloc keeps freed
/// memory for the next batch.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(app::cli::run(std::env::args_os()))
}
