//! The command line of `cargo xtask ablate`.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::report::{Cell, Sweep};
use clap::Args;
use files::InputError;

use crate::program_check::check_package;

/// Run a sweep: fits with different parameters, their errors, their gradients, and a report
#[derive(Args, Debug)]
pub struct Ablate {
    /// A shipped sweep (k-gamma, high-gamma, bare, steps-epsilon, steps-refined, filters,
    /// precision, detail, smoke) or a TOML file
    #[arg(required_unless_present = "compare")]
    pub(crate) sweep: Option<String>,
    /// Output folder; finished cells in it are not run again
    #[arg(short, long)]
    pub(crate) output: Option<PathBuf>,
    /// Number of cells that run at a time [default: the number of cores]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) jobs: Option<u32>,
    /// List the cells and estimate the time; run no cell
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Run only cells whose name contains this text; if repeated, all texts
    #[arg(long)]
    pub(crate) only: Vec<String>,
    /// Run the cells with this program; the package is not built
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) binary: Option<PathBuf>,
    /// Run only part I of N, in a folder of its own; a task of a Slurm array finds its part by
    /// itself
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<String>,
    /// Write the script of a Slurm job array; run no cell
    #[arg(long)]
    pub(crate) slurm: bool,
    /// Number of tasks of the Slurm array
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) shards: u32,
    /// Gather the finished cells of these folders in the output folder; run no cell
    #[arg(long, num_args = 1.., value_name = "DIR")]
    pub(crate) merge: Vec<PathBuf>,
    /// Compare the results of two sweeps, given as folders or as files results.csv
    #[arg(long, num_args = 2, value_names = ["A", "B"])]
    pub(crate) compare: Vec<PathBuf>,
}

impl Ablate {
    /// The program of the cells: the one of `--binary`, or the sweep's package, which is built.
    ///
    /// # Errors
    /// An [`InputError`] if there is no such program or package; any error of the build.
    pub(crate) fn program(&self, sweep: &Sweep, file: &Path) -> Result<PathBuf, Error> {
        match &self.binary {
            Some(path) if path.is_file() => Ok(std::path::absolute(path)?),
            Some(path) => {
                Err(InputError::new(path, "--binary", "no file", "a program like dsdf").into())
            }
            None => {
                check_package(sweep, file)?;
                crate::measure::dsdf::build_package(&sweep.package, sweep.profile.name())
            }
        }
    }

    /// The cells of a sweep that `--only` selects.
    ///
    /// # Errors
    /// An [`InputError`] if there are none.
    pub(crate) fn selected(&self, sweep: &Sweep) -> Result<Vec<Cell>, InputError> {
        let wanted = |cell: &Cell| self.only.iter().all(|text| cell.name.contains(text));
        let cells: Vec<Cell> = sweep.cells().into_iter().filter(wanted).collect();
        if cells.is_empty() {
            let found = self.only.join(" ");
            let expected = "part of a cell's name";
            return Err(InputError::new(Path::new("arguments"), "--only", found, expected));
        }
        Ok(cells)
    }

    /// Makes the output folder, and returns its absolute path.
    pub(crate) fn output_folder(&self) -> Result<PathBuf, InputError> {
        let Some(output) = &self.output else {
            let file = Path::new("arguments");
            return Err(InputError::new(file, "-o", "nothing", "a folder to write"));
        };
        make_folder(output)
    }

    /// The options of a task in a Slurm array: those that select the cells and the program.
    pub(crate) fn task_options(&self, jobs: usize, binary: &Path) -> Vec<String> {
        let mut options = vec!["--jobs".to_owned(), jobs.to_string()];
        if self.binary.is_some() {
            options.extend(["--binary".to_owned(), binary.display().to_string()]);
        }
        options.extend(self.only.iter().flat_map(|text| ["--only".to_owned(), text.clone()]));
        options
    }
}

/// Makes a folder, and returns its absolute path.
pub(crate) fn make_folder(folder: &Path) -> Result<PathBuf, InputError> {
    let made = std::fs::create_dir_all(folder).and_then(|()| std::path::absolute(folder));
    made.map_err(|e| InputError::new(folder, "-o", e, "a folder that can be written"))
}
