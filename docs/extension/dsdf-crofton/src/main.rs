//! The program `dsdf` with one more estimator: `--estimator crofton`.

use std::process::ExitCode;

use estimate::{Entry, Registry};

/// The allocator of `dsdf`, so that the times of both programs compare.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let mut registry = Registry::default();
    registry.add(Entry {
        name: "crofton",
        summary: "silhouettes by bisection along random lines, and Crofton's formula",
        single: |_| Box::new(crofton::Crofton),
        double: |_| Box::new(crofton::Crofton),
    });
    ExitCode::from(app::cli::run_with(std::env::args_os(), registry))
}
