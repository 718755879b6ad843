#![doc = include_str!("../README.md")]
#![allow(clippy::print_stderr, reason = "a sweep reports its progress")]

mod arguments;
mod cell;
mod console;
mod dry_run;
mod error;
mod fit_metrics;
mod fit_stage;
mod folder;
mod gradient_test;
mod inputs;
pub mod measure;
mod pool;
mod prepared;
mod process;
mod program_check;
pub mod report;
mod runner;
mod slurm;

use std::path::{Path, PathBuf};

pub use arguments::Ablate;
pub use error::{Error, ProcessFailure};

use crate::report::Sweep;
use crate::report::files::write_whole;
use console::print;
use folder::SweepFolder;
use prepared::PreparedSweep;
use slurm::Shard;

/// Runs `cargo xtask ablate`: compares two sweeps, merges shards, lists the cells, writes a Slurm
/// script, or runs the cells and writes a report.
///
/// # Errors
/// [`Error::Input`] for wrong input, before any cell runs. Other errors are failures of files, of the
/// build or of the machine. A cell that fails is no error: its result has the reason.
pub fn run(arguments: &Ablate) -> Result<(), Error> {
    if let [a, b] = &arguments.compare[..] {
        return compare(a, b, arguments);
    }
    let name = arguments.sweep.as_deref().unwrap_or_default();
    let loaded = Sweep::load(name)?;
    let shard = Shard::read(arguments.shard.as_deref(), |name| std::env::var(name).ok())?;
    if !arguments.merge.is_empty() {
        return merge(loaded, arguments);
    }
    let prepared = PreparedSweep::new(arguments, name, loaded, shard)?;
    if arguments.dry_run {
        return prepared.dry_run();
    }
    let output = arguments.output_folder()?;
    prepared.check_output(&output)?;
    if arguments.slurm {
        return prepared.write_slurm_script(name, &output);
    }
    prepared.run(output)
}

/// Prints the comparison of two sweeps, and keeps it in the output folder if there is one.
fn compare(a: &Path, b: &Path, arguments: &Ablate) -> Result<(), Error> {
    let page = report::compare(a, b)?;
    if arguments.output.is_some() {
        write_whole(&arguments.output_folder()?.join("compare.md"), &page)?;
    }
    print(&page);
    Ok(())
}

/// Gathers shards in the output folder, and writes the report of all their cells.
fn merge((sweep, base): (Sweep, PathBuf), arguments: &Ablate) -> Result<(), Error> {
    let folder = SweepFolder { sweep, base, output: arguments.output_folder()? };
    let _lock = folder.lock()?;
    folder.merge(&arguments.merge)?;
    folder.write_report()
}
