//! A sweep that is ready to run: checked, with its program and its selected cells.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::report::files::write_whole;
use crate::report::results::finished;
use crate::report::{Cell, Sweep, absolute};
use files::InputError;

use crate::arguments::{Ablate, make_folder};
use crate::console::print;
use crate::folder::SweepFolder;
use crate::program_check::{check_data, check_options};
use crate::runner::CellRunner;
use crate::slurm::{self, JobArray, Shard, shard_folder};
use crate::{dry_run, inputs, pool};

/// A checked sweep with its program and the cells to run.
pub(crate) struct PreparedSweep<'a> {
    arguments: &'a Ablate,
    sweep: Sweep,
    /// The folder of the sweep file, where its paths start.
    base: PathBuf,
    binary: PathBuf,
    shard: Option<Shard>,
    /// The selected cells of this shard, or of the whole sweep.
    cells: Vec<Cell>,
    cores: usize,
    /// Cells at a time.
    jobs: usize,
}

impl<'a> PreparedSweep<'a> {
    /// Builds or finds the program, checks the sweep with it, and selects the cells.
    pub(crate) fn new(
        arguments: &'a Ablate,
        name: &str,
        (sweep, base): (Sweep, PathBuf),
        shard: Option<Shard>,
    ) -> Result<Self, Error> {
        let file = Path::new(name);
        let binary = arguments.program(&sweep, file)?;
        check_options(&sweep, file, &binary)?;
        check_data(&sweep, &base, file, &binary)?;
        // With more shards than cells, some shards have no cell.
        let of_shard = |(number, _): &(usize, Cell)| shard.is_none_or(|shard| shard.holds(*number));
        let selected = arguments.selected(&sweep)?.into_iter().enumerate().filter(of_shard);
        let cells = selected.map(|(_, cell)| cell).collect();
        let cores = slurm::cores(|name| std::env::var(name).ok())
            .unwrap_or(std::thread::available_parallelism().map_or(1, usize::from));
        let jobs = arguments.jobs.map_or(cores, |jobs| jobs as usize);
        Ok(PreparedSweep { arguments, sweep, base, binary, shard, cells, cores, jobs })
    }

    /// Lists the cells and estimates the time.
    pub(crate) fn dry_run(self) -> Result<(), Error> {
        let output = self.arguments.output.clone().unwrap_or_else(|| PathBuf::from("."));
        let folder = SweepFolder { sweep: self.sweep, base: self.base, output };
        dry_run::show(&folder, &self.binary, &self.cells, self.jobs)
    }

    /// Refuses an output folder inside a data set: its files would be taken for photographs.
    pub(crate) fn check_output(&self, output: &Path) -> Result<(), Error> {
        for data in self.sweep.data.iter().flat_map(|data| &data.dataset) {
            if output.starts_with(std::path::absolute(self.base.join(data))?) {
                let found = format!("a folder in {data}");
                let expected = "one outside of the data sets";
                return Err(InputError::new(output, "-o", found, expected).into());
            }
        }
        Ok(())
    }

    /// Writes `submit.sh`, the script of a Slurm job array, and prints its path.
    pub(crate) fn write_slurm_script(&self, name: &str, output: &Path) -> Result<(), Error> {
        let program = std::env::current_exe()?.to_string_lossy().into_owned();
        let folder = output.to_string_lossy().into_owned();
        let merge = vec![program, "ablate".to_owned(), absolute(name)?, "-o".to_owned(), folder];
        let array = JobArray {
            run: [merge.clone(), self.arguments.task_options(self.jobs, &self.binary)].concat(),
            merge,
            cells: self.cells.len(),
            jobs: self.jobs,
            shards: self.arguments.shards as usize,
        };
        let path = output.join("submit.sh");
        write_whole(&path, array.script(&self.sweep, output))?;
        print(&format!("{}\n", path.display()));
        Ok(())
    }

    /// Runs the cells that are not finished, and writes results and report.
    pub(crate) fn run(self, output: PathBuf) -> Result<(), Error> {
        let output = match self.shard {
            Some(shard) => make_folder(&shard_folder(&output, shard))?,
            None => output,
        };
        let folder = SweepFolder { sweep: self.sweep, base: self.base, output };
        let _lock = folder.lock()?;
        inputs::check(&folder.output, &self.binary, &folder.sweep.data, &folder.base)?;
        if self.cells.iter().any(|cell| finished(&folder.cell(cell)).is_none()) {
            let machine = inputs::this_machine(self.cores, self.arguments.binary.is_some());
            inputs::add_machines(&folder.output, vec![machine])?;
        }
        let data = folder.data_folders(&self.binary)?;
        let runner = CellRunner {
            sweep: &folder.sweep,
            binary: &self.binary,
            data: &data,
            cells: folder.cells(),
            threads: (self.cores / self.jobs).max(1),
        };
        pool::run(&runner, &self.cells, self.jobs)?;
        folder.write_report()
    }
}
