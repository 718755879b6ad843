//! `cargo xtask ablate`: sweeps over what the method leaves open.

mod cell;
mod claims;
mod compare;
mod gradients;
mod inputs;
mod pictures;
mod plan;
mod pool;
mod process;
mod refusal;
mod report;
mod results;
mod slurm;
mod statistics;
mod sweep;
mod tables;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;

use cell::Bench;
pub use refusal::Refusal;
use results::{finished, write};
use slurm::Shard;
use sweep::{Cell, Sweep};

/// Run a sweep over parameters: fits, their quality, their gradients, and a report
#[derive(Args, Debug)]
pub struct Ablate {
    /// A shipped sweep (k-gamma, high-gamma, steps-epsilon, steps-refined, filters, precision,
    /// smoke) or a TOML file
    #[arg(required_unless_present = "compare")]
    sweep: Option<String>,
    /// The folder to write; what is finished there is not run again
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Cells at a time [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Show the cells and an estimate of the time, and run none
    #[arg(long)]
    dry_run: bool,
    /// Only cells whose name holds this text; all of several
    #[arg(long)]
    only: Vec<String>,
    /// The program that runs the cells, instead of the package's
    #[arg(long, value_name = "PROGRAM")]
    binary: Option<PathBuf>,
    /// Only part I of N, in a folder of its own; a task of a Slurm array takes its own part without
    /// being told
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
    /// Write the script of a Slurm job array instead
    #[arg(long)]
    slurm: bool,
    /// Tasks of the array
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    shards: u32,
    /// Gather the cells of these folders in the output folder
    #[arg(long, num_args = 1.., value_name = "DIR")]
    merge: Vec<PathBuf>,
    /// Compare the results of two sweeps: folders, or their results.csv
    #[arg(long, num_args = 2, value_names = ["A", "B"])]
    compare: Vec<PathBuf>,
}

/// A sweep with where things are.
struct Work {
    sweep: Sweep,
    /// What the sweep's own paths start from.
    folder: PathBuf,
    output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// A [`Refusal`] for wrong input; anything else as it is.
pub fn run(arguments: &Ablate) -> anyhow::Result<()> {
    if let [a, b] = &arguments.compare[..] {
        let page = compare::compare(a, b)?;
        if arguments.output.is_some() {
            write(&make_folder(arguments.output.as_deref())?.join("compare.md"), &page)?;
        }
        say(&page);
        return Ok(());
    }
    let name = arguments.sweep.as_deref().unwrap_or_default();
    let (sweep, folder) = Sweep::load(name)?;
    let variable = |name: &str| std::env::var(name).ok();
    let shard = Shard::read(arguments.shard.as_deref(), variable)?;
    if !arguments.merge.is_empty() {
        let output = make_folder(arguments.output.as_deref())?;
        let work = Work { sweep, folder, output };
        let _lock = work.claim()?;
        work.merge(&arguments.merge)?;
        return work.report();
    }
    let binary = match &arguments.binary {
        Some(path) if path.is_file() => std::path::absolute(path)?,
        Some(path) => {
            return Err(Refusal::new(path, "--binary", "no file", "a program like dsdf").into());
        }
        None => {
            plan::check_package(&sweep, name)?;
            measure::dsdf::build_package(&sweep.package, sweep.profile.name())?
        }
    };
    plan::check(&sweep, name, &binary)?;
    plan::check_data(&sweep, &folder, name, &binary)?;
    let wanted = |cell: &Cell| arguments.only.iter().all(|text| cell.name.contains(text));
    let chosen: Vec<Cell> = sweep.cells().into_iter().filter(wanted).collect();
    let cores = slurm::cores(variable)
        .unwrap_or(std::thread::available_parallelism().map_or(1, usize::from));
    let jobs = arguments.jobs.map_or(cores, |jobs| jobs as usize);
    if chosen.is_empty() {
        let expected = "what some cell's name holds";
        return Err(Refusal::new(
            Path::new("arguments"),
            "--only",
            arguments.only.join(" "),
            expected,
        )
        .into());
    }
    // A shard may be empty where there are more of them than cells.
    let own = |(i, _): &(usize, Cell)| shard.is_none_or(|shard| shard.holds(*i));
    let chosen: Vec<Cell> =
        chosen.into_iter().enumerate().filter(own).map(|(_, cell)| cell).collect();
    if arguments.dry_run {
        let output = arguments.output.clone().unwrap_or_else(|| PathBuf::from("."));
        let work = Work { sweep, folder, output };
        return plan::show(&work, &binary, &chosen, jobs);
    }
    let output = make_folder(arguments.output.as_deref())?;
    for data in sweep.data.iter().flat_map(|data| &data.dataset) {
        // What the sweep writes would be taken for part of it.
        if output.starts_with(std::path::absolute(folder.join(data))?) {
            let expected = "one outside of the data sets";
            return Err(Refusal::new(&output, "-o", format!("a folder in {data}"), expected).into());
        }
    }
    if arguments.slurm {
        let name = sweep::absolute(name)?;
        let mut command = vec![
            std::env::current_exe()?.to_string_lossy().into_owned(),
            "ablate".to_owned(),
            name,
        ];
        command.extend(["-o".to_owned(), output.to_string_lossy().into_owned()]);
        let mut run = command.clone();
        run.extend(["--jobs".to_owned(), jobs.to_string()]);
        run.extend(
            arguments
                .binary
                .iter()
                .flat_map(|_| ["--binary".to_owned(), binary.display().to_string()]),
        );
        run.extend(arguments.only.iter().flat_map(|text| ["--only".to_owned(), text.clone()]));
        let job = slurm::Job {
            run,
            merge: command,
            cells: chosen.len(),
            jobs,
            shards: arguments.shards as usize,
        };
        let path = output.join("submit.sh");
        write(&path, job.script(&sweep, &output))?;
        say(&format!("{}\n", path.display()));
        return Ok(());
    }
    let output = match shard {
        Some(shard) => make_folder(Some(&slurm::folder(&output, shard)))?,
        None => output,
    };
    let work = Work { sweep, folder, output };
    let _lock = work.claim()?;
    inputs::check(&work.output, &binary, &work.sweep.data, &work.folder)?;
    if chosen.iter().any(|cell| finished(&work.cell(cell)).is_none()) {
        let machine = inputs::this_machine(cores, arguments.binary.is_some());
        inputs::add_machines(&work.output, vec![machine])?;
    }
    let data = work.photographs(&binary)?;
    let cells = work.output.join("cells");
    let bench = Bench {
        sweep: &work.sweep,
        binary: &binary,
        data: &data,
        cells,
        threads: (cores / jobs).max(1),
    };
    pool::run(&bench, &chosen, jobs)?;
    work.report()
}

/// Standard output, whose reader may have read enough.
fn say(text: &str) {
    let _ = std::io::Write::write_all(&mut std::io::stdout(), text.as_bytes());
}

/// The output folder, which has to be writable.
fn make_folder(output: Option<&Path>) -> anyhow::Result<PathBuf> {
    let Some(output) = output else {
        return Err(
            Refusal::new(Path::new("arguments"), "-o", "nothing", "a folder to write").into()
        );
    };
    let made = std::fs::create_dir_all(output).and_then(|()| std::path::absolute(output));
    Ok(made.map_err(|e| Refusal::new(output, "-o", e, "a folder that can be written"))?)
}

impl Work {
    /// The folder of a cell.
    fn cell(&self, cell: &Cell) -> PathBuf {
        self.output.join("cells").join(&cell.name)
    }

    /// Takes the folder for this sweep: no other sweep's, and no other process's.
    fn claim(&self) -> anyhow::Result<std::fs::File> {
        let path = self.output.join("lock");
        let lock = std::fs::File::create(&path)
            .map_err(|e| Refusal::new(&path, "lock", e, "a folder that can be written"))?;
        if lock.try_lock().is_err() {
            return Err(Refusal::new(
                &self.output,
                "lock",
                "another sweep at work",
                "a folder of one's own",
            )
            .into());
        }
        let (path, text) = (self.output.join("sweep.toml"), toml::to_string(&self.sweep)?);
        if let Some(there) = inputs::read(&path)? {
            self.same(&path, &there)?;
        }
        write(&path, text)?;
        Ok(lock)
    }

    /// Refuses a sweep whose cells would not be the same.
    fn same(&self, path: &Path, there: &str) -> anyhow::Result<()> {
        let own = toml::to_string(&self.sweep.identity())?;
        let other = toml::from_str::<Sweep>(there).map(|sweep| toml::to_string(&sweep.identity()));
        let Ok(Ok(other)) = other else {
            return Err(Refusal::new(
                path,
                "sweep",
                "no sweep",
                "the same sweep, or another folder",
            )
            .into());
        };
        if own != other {
            return Err(Refusal::new(
                path,
                "sweep",
                inputs::changed(&other, &own),
                "the same sweep, or another folder",
            )
            .into());
        }
        Ok(())
    }

    /// The folders of the data sets, with their true surfaces; scenes are photographed once.
    fn photographs(&self, binary: &Path) -> anyhow::Result<Vec<(PathBuf, Option<PathBuf>)>> {
        let own = |name: &str| self.folder.join(name);
        let mut folders = Vec::new();
        for data in &self.sweep.data {
            let mesh = data.mesh.as_deref().map(own);
            if let Some(dataset) = &data.dataset {
                folders.push((std::path::absolute(own(dataset))?, mesh));
                continue;
            }
            let folder = self.output.join("data").join(&data.name);
            if !folder.exists() {
                let scene = own(data.scene.as_deref().unwrap_or_default());
                let (part, views) = (folder.with_extension("part"), data.views.to_string());
                let _ = std::fs::remove_dir_all(&part);
                std::fs::create_dir_all(part.parent().context("a folder")?)?;
                let size = format!("{0}x{0}", data.size);
                let (scene, out) = (scene.to_string_lossy(), part.to_string_lossy());
                let arguments = ["synth", &scene, "-o", &out, "--views", &views, "--size", &size]
                    .map(str::to_owned);
                let log = folder.with_extension("log");
                process::run(binary, &arguments, &self.sweep.limits, &log, &|| {})?.map_err(
                    |e| {
                        Refusal::of(
                            Path::new(&*scene),
                            "data",
                            &e.reason,
                            "a scene to take pictures of",
                        )
                    },
                )?;
                std::fs::rename(&part, &folder)?;
            }
            folders.push((folder.clone(), Some(mesh.unwrap_or_else(|| folder.join("truth.ply")))));
        }
        Ok(folders)
    }

    /// Takes finished cells from other folders of the same sweep.
    fn merge(&self, folders: &[PathBuf]) -> anyhow::Result<()> {
        for folder in folders {
            let path = folder.join("sweep.toml");
            let there = std::fs::read_to_string(&path)
                .map_err(|e| Refusal::new(&path, "sweep", e, "a shard of this sweep"))?;
            self.same(&path, &there)?;
        }
        inputs::merge(folders, &self.output)?;
        for cell in self.sweep.cells() {
            let to = self.cell(&cell);
            let from = folders
                .iter()
                .map(|f| f.join("cells").join(&cell.name))
                .find(|f| finished(f).is_some());
            let Some(from) = from.filter(|_| finished(&to).is_none()) else { continue };
            std::fs::create_dir_all(&to)?;
            for name in ["picture.png", "result.json"] {
                if let Ok(bytes) = std::fs::read(from.join(name)) {
                    write(&to.join(name), bytes)?;
                }
            }
        }
        Ok(())
    }

    /// Results and report of all cells that are finished here, in the sweep's order.
    fn report(&self) -> anyhow::Result<()> {
        let mut pictures = HashMap::new();
        let mut rows = Vec::new();
        for cell in self.sweep.cells() {
            if let Some(mut row) = finished(&self.cell(&cell)) {
                // By the criterion as it is now.
                row.converged =
                    self.sweep.converged.holds(&row, self.sweep.data[cell.data].has_truth());
                pictures.insert(row.key(), self.cell(&cell).join("picture.png"));
                rows.push(row);
            }
        }
        report::report(&self.sweep, &rows, &self.output, &|row| {
            pictures.get(&row.key()).cloned().unwrap_or_default()
        })?;
        say(&format!("{}\n", self.output.join("report.md").display()));
        Ok(())
    }
}
