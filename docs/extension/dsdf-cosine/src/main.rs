//! `dsdf` with one estimator more: `--estimator custom` has the weights of the crate `cosine`.

use std::process::ExitCode;

use app::cli::{Weights, run_with};

fn main() -> ExitCode {
    ExitCode::from(run_with(std::env::args_os(), Some(Weights::of(&cosine::Cosine))))
}
