//! The `dsdf` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(app::cli::run(std::env::args_os()))
}
