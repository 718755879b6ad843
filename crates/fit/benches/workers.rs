//! A simulation of iterations on many threads: one thread computes all tasks of a run's iterations,
//! and their times are dealt to workers.
//!
//! It does not measure what threads do to each other: waking up, shared caches and memory. Run it
//! with the folder of a run that is not at its end, the number of workers and of iterations; the
//! result is a JSON object.

#![allow(clippy::print_stdout, reason = "a benchmark")]

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use estimate::Registry;
use fit::{RunFile, RunFolder, Session, Stage};
use serde_json::json;

/// The allocator of the program `dsdf`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The result of a step of this program.
type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Iterations before the first that counts.
const WARM_UP: u64 = 10;

/// A task: its stage, and the seconds of its begin and end.
type Task = (Stage, f64, f64);

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let [run, workers, iterations] = &arguments[..] else {
        return Err("expected a run folder, a number of workers and a number of iterations".into());
    };
    let (run, workers, iterations) = (PathBuf::from(run), workers.parse()?, iterations.parse()?);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let tasks = pool.install(|| tasks_of(&run, workers, iterations).map_err(|e| e.to_string()))?;
    println!("{}", simulated(&tasks, workers)?);
    Ok(())
}

/// The tasks of some iterations of a run, shared as for this number of workers.
fn tasks_of(run: &Path, workers: usize, iterations: u64) -> Result<Vec<Vec<Task>>> {
    let mut file = RunFile::load(run)?;
    // fit.toml holds no larger integer.
    file.options.preview_every = i64::MAX as u64;
    file.options.checkpoint_every = i64::MAX as u64;
    let dataset = file.read(None)?;
    let dataset = file.prepare(dataset);
    // The run is not changed: files of the end go to another folder.
    let copy = tempfile::tempdir()?;
    let [from, to] = [run, copy.path()].map(RunFolder::new);
    for folder in to.subfolders() {
        std::fs::create_dir_all(folder)?;
    }
    for [from, to] in [[from.checkpoint(), to.checkpoint()], [from.fit_toml(), to.fit_toml()]] {
        std::fs::copy(&from, to).map_err(|e| format!("{}: {e}", from.display()))?;
    }
    let mut session = Session::new(copy.path(), dataset, file, &Registry::default(), true)?;
    let begin = Instant::now();
    let log = Arc::new(Mutex::new(Vec::<Task>::new()));
    let events = Arc::clone(&log);
    let observer = move |stage: Stage, begins: bool| {
        let now = begin.elapsed().as_secs_f64();
        let Ok(mut events) = events.lock() else { return };
        match events.last_mut().filter(|_| !begins) {
            Some(last) => last.2 = now,
            None => events.push((stage, now, now)),
        }
    };
    session.observe(workers, Box::new(observer));
    let (done, mut all) = (Cell::new(0), Vec::new());
    let report = &mut |_: &Session, _: &fit::Metrics| -> Result<()> {
        done.set(done.get() + 1);
        all.extend(log.lock().map(|mut log| std::mem::take(&mut *log)));
        Ok(())
    };
    session.run(&|| done.get() >= WARM_UP + iterations, report)?;
    Ok(all.into_iter().skip(WARM_UP as usize).collect())
}

/// The stages of an iteration.
const STAGES: [Stage; 10] = [
    Stage::Clear,
    Stage::Soft,
    Stage::Trace,
    Stage::Record,
    Stage::Deal,
    Stage::Reverse,
    Stage::ReverseRecord,
    Stage::Backward,
    Stage::Sum,
    Stage::Caller,
];

/// Times per iteration, in milliseconds, and the efficiency: the time of all tasks and of the rest,
/// over the workers' time. Medians over the iterations: what else the machine does can lengthen a
/// task of some of them by much.
fn simulated(iterations: &[Vec<Task>], workers: usize) -> Result<serde_json::Value> {
    let taken = |(_, begin, end): &Task| end - begin;
    let begin = |iteration: &[Task]| iteration.first().map_or(0.0, |task| task.1);
    let (mut all, mut rest, mut ends) = (Vec::new(), Vec::new(), Vec::new());
    for both in iterations.windows(2) {
        let seconds = begin(&both[1]) - begin(&both[0]);
        all.push(seconds);
        rest.push(seconds - both[0].iter().map(taken).sum::<f64>());
        ends.push(end_of(&both[0], workers) + rest[rest.len() - 1]);
    }
    let [Some(all), Some(rest), Some(end)] = [all, rest, ends].map(median) else {
        return Err("the run has no iterations left".into());
    };
    let of_stage = |stage: Stage| {
        let own = |iteration: &[Task]| {
            iteration.iter().filter(|task| task.0 == stage).map(taken).collect::<Vec<f64>>()
        };
        let all: Vec<Vec<f64>> = iterations.iter().map(|iteration| own(iteration)).collect();
        let [tasks, seconds, longest] = [
            all.iter().map(|own| own.len() as f64).collect(),
            all.iter().map(|own| own.iter().sum()).collect(),
            all.iter().map(|own| own.iter().copied().fold(0.0, f64::max)).collect(),
        ]
        .map(|of| median(of).unwrap_or(0.0));
        let [ms, longest_ms] = [seconds, longest].map(|seconds| seconds * 1e3);
        let name = format!("{stage:?}");
        (tasks > 0.0)
            .then(|| json!({"stage": name, "tasks": tasks, "ms": ms, "longest_ms": longest_ms}))
    };
    Ok(json!({
        "workers": workers,
        "iterations": iterations.len() - 1,
        "ms": all * 1e3,
        "rest_ms": rest * 1e3,
        "simulated_ms": end * 1e3,
        "speed_up": all / end,
        "efficiency": all / end / workers as f64,
        "stages": STAGES.into_iter().filter_map(of_stage).collect::<Vec<_>>(),
    }))
}

fn median(mut of: Vec<f64>) -> Option<f64> {
    of.sort_by(f64::total_cmp);
    of.get(of.len() / 2).copied()
}

/// The time at which all tasks of an iteration end: each goes to the first worker that is free, when
/// the stage before has ended. Reverse mode does not wait for records, as in [`fit`]. Loops of the
/// caller are shared equally.
fn end_of(iteration: &[Task], workers: usize) -> f64 {
    let latest = |free: &[f64]| free.iter().copied().fold(0.0, f64::max);
    let mut free = vec![0.0f64; workers];
    let (mut before, mut beside_records) = (None, false);
    // The time from which tasks of the stage can begin, and the last end of one.
    let (mut from, mut last) = (0.0f64, 0.0f64);
    for (stage, begin, end) in iteration {
        if before != Some(*stage) {
            beside_records = match stage {
                Stage::Deal => before == Some(Stage::Record),
                Stage::Reverse | Stage::Backward => beside_records,
                _ => false,
            };
            from = match (beside_records, stage) {
                (true, Stage::Deal) => from,
                (true, _) => last,
                (false, _) => latest(&free),
            };
            (before, last) = (Some(*stage), from);
        }
        if *stage == Stage::Caller {
            free.fill(from + (end - begin) / workers as f64);
            before = None;
            continue;
        }
        let first = (0..workers).min_by(|a, b| free[*a].total_cmp(&free[*b])).unwrap_or(0);
        free[first] = free[first].max(from) + end - begin;
        last = last.max(free[first]);
    }
    latest(&free)
}
