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

/// The stages of an iteration, in their order.
const STAGES: [Stage; 8] = [
    Stage::Clear,
    Stage::Soft,
    Stage::Trace,
    Stage::Record,
    Stage::Reverse,
    Stage::Backward,
    Stage::Sum,
    Stage::Parameters,
];

/// The mean times per iteration, in milliseconds, and the efficiency: the time of all tasks and of
/// the rest, over the workers' time.
fn simulated(iterations: &[Vec<Task>], workers: usize) -> Result<serde_json::Value> {
    if iterations.len() < 2 {
        return Err("the run has no iterations left".into());
    }
    let count = (iterations.len() - 1) as f64;
    let mean = |seconds: f64| seconds * 1e3 / count;
    let (mut stages, mut busy, mut ends) = (Vec::new(), 0.0, 0.0);
    for stage in STAGES {
        let (mut own_busy, mut own_end, mut tasks) = (0.0, 0.0, 0);
        for iteration in &iterations[..iterations.len() - 1] {
            let times: Vec<f64> = iteration
                .iter()
                .filter(|(of, ..)| *of == stage)
                .map(|(_, begin, end)| end - begin)
                .collect();
            tasks += times.len();
            own_busy += times.iter().sum::<f64>();
            own_end += end_of(&times, stage, workers);
        }
        busy += own_busy;
        ends += own_end;
        if tasks > 0 {
            let (tasks, all, end) = (tasks as f64 / count, mean(own_busy), mean(own_end));
            let name = format!("{stage:?}");
            stages.push(json!({"stage": name, "tasks": tasks, "ms": all, "simulated_ms": end}));
        }
    }
    let begin = |iteration: &Vec<Task>| iteration.first().map_or(0.0, |task| task.1);
    let all = begin(&iterations[iterations.len() - 1]) - begin(&iterations[0]);
    let rest = all - busy;
    let end = ends + rest;
    Ok(json!({
        "workers": workers,
        "iterations": count,
        "ms": mean(all),
        "rest_ms": mean(rest),
        "simulated_ms": mean(end),
        "speed_up": all / end,
        "efficiency": all / end / workers as f64,
        "stages": stages,
    }))
}

/// The time at which all tasks of a stage end: each goes to the first worker that is free. Loops
/// over parameters are shared equally.
fn end_of(times: &[f64], stage: Stage, workers: usize) -> f64 {
    if stage == Stage::Parameters {
        return times.iter().sum::<f64>() / workers as f64;
    }
    let mut free = vec![0.0f64; workers];
    for time in times {
        let first = (0..workers).min_by(|a, b| free[*a].total_cmp(&free[*b])).unwrap_or(0);
        free[first] += time;
    }
    free.into_iter().fold(0.0, f64::max)
}
