//! `cargo xtask record`: measures every table and figure that pages quote, a row at a time.

mod ablate;
mod code;
mod derivatives;
mod detail;
mod estimators;
mod extremes;
mod filters;
mod fits;
mod math;
mod measurement;
mod pages;
mod peers;
mod rows;
mod speed;
mod steps;
mod tradeoff;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::ScopedJoinHandle;
use std::time::{Instant, SystemTime};

use anyhow::{Context, anyhow, bail};
use clap::Args;
use sweep::measure::host::{processor, revision};
use sweep::measure::{dsdf, workspace_root};

use crate::arguments::WrongArgument;
use code::{Code, short_digest};
use measurement::{Bench, Measurement, Skipped};
pub(crate) use pages::check as check_page;
use rows::{Planned, Row, Rows};

/// Measure every table and figure that the README and docs quote; rows that are current are kept
#[derive(Args)]
pub(crate) struct Record {
    /// The measurements; all of them without a name
    names: Vec<String>,
    /// List the rows that are missing or older than the code they measure; measure nothing
    #[arg(long)]
    list: bool,
    /// Rows that are measured at a time, where a row uses one thread
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: u32,
    /// Measure only rows whose name contains this text; several times: one of these texts
    #[arg(long, value_name = "TEXT")]
    only: Vec<String>,
    /// Write tables, plots and pages of the rows that are there; measure nothing
    #[arg(long, conflicts_with = "list")]
    tables: bool,
}

/// All measurements.
const ALL: &[&dyn Measurement] = &[
    &derivatives::Derivatives,
    &fits::Fits,
    &detail::Detail,
    &estimators::Estimators,
    &steps::Steps,
    &filters::Filters,
    &tradeoff::Tradeoff,
    &speed::Speed,
    &extremes::Extremes,
    &peers::Peers,
    &math::Math,
    &ablate::Ablations,
];

/// The state of a planned row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// It was measured with the code and the command of today.
    Current,
    /// The code or the command has changed since.
    Stale,
    /// It was never measured.
    Missing,
}

/// A measurement with its plan and the rows that are there.
struct Work {
    of: &'static dyn Measurement,
    folder: PathBuf,
    plan: Vec<Planned>,
    rows: Rows,
    digest: String,
    /// The commits of older rows, with what has changed since.
    changes: BTreeMap<String, String>,
}

impl Work {
    fn new(of: &'static dyn Measurement, code: &Code) -> anyhow::Result<Self> {
        let folder = workspace_root().join("docs/results").join(of.name());
        let digest = code.digest(of.measured())?;
        let (mut rows, mut changes) = (Rows::load(&folder)?, BTreeMap::new());
        let mut current = BTreeSet::new();
        for row in rows.0.values_mut().filter(|row| row.code != digest) {
            if !current.contains(&row.commit) && !changes.contains_key(&row.commit) {
                match code.difference(&row.commit, of.measured())? {
                    Some(change) => drop(changes.insert(row.commit.clone(), change)),
                    None => drop(current.insert(row.commit.clone())),
                }
            }
            if current.contains(&row.commit) {
                row.code.clone_from(&digest);
            }
        }
        Ok(Work { of, plan: of.plan()?, rows, digest, folder, changes })
    }

    /// The rows of the plan whose names contain one of the texts; all of them without a text.
    fn wanted<'a>(&'a self, only: &'a [String]) -> impl Iterator<Item = &'a Planned> {
        let is_named = |row: &&Planned| only.iter().any(|text| row.name.contains(text));
        self.plan.iter().filter(move |row| only.is_empty() || is_named(row))
    }

    fn state(&self, row: &Planned) -> State {
        match self.rows.0.get(&row.name) {
            None => State::Missing,
            Some(old)
                if old.code == self.digest
                    && old.command == row.command
                    && old.seeds == row.seeds =>
            {
                State::Current
            }
            Some(_) => State::Stale,
        }
    }

    /// The rows to measure; those whose data are not here only with `absent`.
    fn due(&self, only: &[String]) -> (Vec<Planned>, Vec<Planned>) {
        let due = self.wanted(only).filter(|row| self.state(row) != State::Current);
        due.cloned().partition(|row| row.needs.as_ref().is_none_or(|path| path.exists()))
    }

    /// Removes rows that no plan has any more.
    fn forget(&mut self) {
        let planned = |name: &String| self.plan.iter().any(|row| row.name == *name);
        self.rows.0.retain(|name, _| planned(name));
    }
}

impl Record {
    /// Measures, or lists.
    ///
    /// # Errors
    /// If a name is unknown, or a measurement fails.
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        // Rows that another process saves would be lost.
        let _lock = if self.list { None } else { Some(lock()?) };
        let code = Code::read(&workspace_root())?;
        let mut all = Vec::new();
        for of in self.wanted()? {
            all.push(Work::new(of, &code)?);
        }
        let matches = |text: &String| {
            all.iter().flat_map(|work| &work.plan).any(|row| row.name.contains(text))
        };
        if let Some(text) = self.only.iter().find(|text| !matches(text)) {
            return Err(WrongArgument(format!("--only {text}: no row has this text")).into());
        }
        if self.list {
            return list(&all, &self.only);
        }
        let measured = if self.tables { Ok(()) } else { self.measure(&mut all) };
        for work in &mut all {
            work.forget();
            if !work.rows.0.is_empty() {
                work.rows.save(&work.folder)?;
                work.of.write(&work.rows, &work.folder)?;
            }
        }
        pages::refresh(&workspace_root())?;
        measured
    }

    /// The measurements that the arguments name.
    fn wanted(&self) -> anyhow::Result<Vec<&'static dyn Measurement>> {
        let names = || ALL.iter().map(|of| of.name()).collect::<Vec<_>>().join(", ");
        let find = |name: &String| {
            let found = ALL.iter().find(|of| of.name() == name);
            let wrong =
                || WrongArgument(format!("{name}: no measurement, expected one of {}", names()));
            found.copied().ok_or_else(|| wrong().into())
        };
        if self.names.is_empty() {
            return Ok(ALL.to_vec());
        }
        let mut wanted: Vec<&'static dyn Measurement> = Vec::new();
        for of in self.names.iter().map(find).collect::<anyhow::Result<Vec<_>>>()? {
            if wanted.iter().all(|own| own.name() != of.name()) {
                wanted.push(of);
            }
        }
        Ok(wanted)
    }

    /// Measures all rows that are due. A row is saved as soon as it is measured.
    fn measure(&self, all: &mut [Work]) -> anyhow::Result<()> {
        let due: Vec<_> = all.iter().map(|work| work.due(&self.only)).collect();
        let count: usize = due.iter().map(|(here, _)| here.len()).sum();
        for (work, (_, absent)) in all.iter().zip(&due) {
            for row in absent {
                let path = row.needs.as_deref().unwrap_or(Path::new(""));
                eprintln!(
                    "SKIPPED {}: {}: {} is not here",
                    work.of.name(),
                    row.name,
                    path.display()
                );
            }
        }
        if count == 0 {
            return Ok(());
        }
        let program = own_program(&dsdf::build()?)?;
        let commit = revision();
        let (mut number, mut failed) = (0, 0);
        for (work, (here, _)) in all.iter_mut().zip(due) {
            std::fs::create_dir_all(&work.folder)?;
            let (single, others): (Vec<_>, Vec<_>) =
                here.into_iter().partition(|row| row.is_single);
            let batches = [(single, self.jobs as usize), (others, 1)];
            for (batch, jobs) in batches {
                let first = number;
                number += batch.len();
                failed += measure_rows(work, &batch, (&program, &commit), jobs, (first, count))?;
            }
        }
        if failed > 0 {
            bail!("{failed} of {count} rows failed: the same command tries them again");
        }
        Ok(())
    }
}

/// Measures rows of one measurement, `jobs` at a time, and returns how many failed. `first` of `count`
/// rows were measured before.
fn measure_rows(
    work: &mut Work,
    batch: &[Planned],
    program: (&Path, &str),
    jobs: usize,
    (first, count): (usize, usize),
) -> anyhow::Result<usize> {
    let Work { of, rows, digest, folder, .. } = work;
    let (next, failed, rows) = (AtomicUsize::new(0), AtomicUsize::new(0), Mutex::new(rows));
    let locked = || rows.lock().map_err(|_| anyhow!("another row failed"));
    let one_after_the_other = || -> anyhow::Result<()> {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(planned) = batch.get(number) else { return Ok(()) };
            let last = locked()?.0.get(&planned.name).map(|row| row.seconds);
            let last = last.map_or(String::new(), |seconds| format!(" ({seconds:.0} s last time)"));
            let name = format!("{}: {}", of.name(), planned.name);
            eprintln!("{} of {count}: {name}{last}", first + number + 1);
            let scratch = scratch(of.name(), digest, planned)?;
            match measure_row(*of, planned, program, (&scratch, folder), (digest, jobs)) {
                Ok(row) => {
                    let mut rows = locked()?;
                    rows.0.insert(planned.name.clone(), row);
                    rows.save(folder)?;
                    std::fs::remove_dir_all(&scratch)?;
                }
                Err(error) if error.is::<Skipped>() => eprintln!("SKIPPED {name}: {error}"),
                // The others can be measured all the same.
                Err(error) => {
                    eprintln!("FAILED {name}: {error:#}");
                    failed.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        let start = |_| scope.spawn(one_after_the_other);
        let workers: Vec<_> = (0..jobs.min(batch.len())).map(start).collect();
        let joined = |worker: ScopedJoinHandle<'_, anyhow::Result<()>>| {
            worker.join().map_err(|_| anyhow!("a measurement panicked"))?
        };
        // All of them end before an error is returned.
        let results: Vec<_> = workers.into_iter().map(joined).collect();
        results.into_iter().collect::<anyhow::Result<()>>()
    })?;
    Ok(failed.into_inner())
}

/// Measures one row.
fn measure_row(
    of: &dyn Measurement,
    planned: &Planned,
    (program, commit): (&Path, &str),
    (scratch, folder): (&Path, &Path),
    (digest, jobs): (&str, usize),
) -> anyhow::Result<Row> {
    let begin = Instant::now();
    let values = of.measure(planned, &Bench { program, scratch, folder })?;
    Ok(Row {
        command: planned.command.clone(),
        seeds: planned.seeds.clone(),
        code: digest.to_owned(),
        commit: commit.to_owned(),
        machine: processor(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        date: today(),
        seconds: begin.elapsed().as_secs_f64(),
        jobs,
        values,
    })
}

/// A copy of the program, so that a build of other code meanwhile does not change what is measured.
fn own_program(built: &Path) -> anyhow::Result<PathBuf> {
    let folder = workspace_root().join("target/record");
    std::fs::create_dir_all(&folder)?;
    let own = folder.join(built.file_name().context("a program")?);
    // A running program cannot be written to, but its name can be taken.
    let new = folder.join("new-program");
    std::fs::copy(built, &new)?;
    std::fs::rename(&new, &own)?;
    Ok(own)
}

/// The folder of a row's own files, which outlives a measurement that is killed. Other code and
/// another command have another one.
fn scratch(measurement: &str, digest: &str, row: &Planned) -> anyhow::Result<PathBuf> {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    let name: String = row.name.chars().map(plain).collect();
    let command = short_digest(&row.command)?;
    let path = workspace_root().join("target/record").join(measurement).join(digest);
    let path = path.join(format!("{name}-{command}"));
    std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    Ok(path)
}

/// The day, in UTC.
fn today() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string().chars().take(10).collect()
}

/// Keeps a second process from measuring in this checkout, until the file is dropped.
fn lock() -> anyhow::Result<File> {
    let folder = workspace_root().join("target/record");
    std::fs::create_dir_all(&folder)?;
    let file = File::create(folder.join("lock"))?;
    if file.try_lock().is_err() {
        bail!("another `cargo xtask record` is measuring in this checkout: wait for it");
    }
    Ok(file)
}

/// Prints what is missing or older than its code, of the rows whose names contain one of
/// the texts.
fn list(all: &[Work], only: &[String]) -> anyhow::Result<()> {
    let mut due = 0;
    for work in all {
        let rows: Vec<&Planned> = work.wanted(only).collect();
        let count = |state| rows.iter().filter(|row| work.state(row) == state).count();
        let [current, stale, missing] = [State::Current, State::Stale, State::Missing].map(count);
        println!(
            "{}: {current} of {} rows are current, {stale} are older than {}, {missing} are missing",
            work.of.name(),
            rows.len(),
            work.of.measured().join(", "),
        );
        for row in rows {
            match work.state(row) {
                State::Current => continue,
                State::Stale => {
                    let old = &work.rows.0[&row.name];
                    let why = work.changes.get(&old.commit).filter(|_| old.code != work.digest);
                    let why = why.map_or("its command differs", String::as_str);
                    println!("  older: {} ({}, {}): {why}", row.name, old.commit, old.date);
                }
                State::Missing => println!("  missing: {}", row.name),
            }
            due += 1;
        }
    }
    if due == 0 {
        println!("nothing is older than the code that it measures");
    } else {
        println!("{due} rows to measure: cargo xtask record");
    }
    Ok(())
}
