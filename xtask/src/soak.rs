//! `cargo xtask soak`: fits that are killed at random moments, and a fit that runs for long.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::{Value, json};
use sweep::measure::dsdf::{self, run_json};

use crate::arguments::minutes;

/// Arguments of `cargo xtask soak`.
#[derive(Args)]
pub(crate) struct Soak {
    /// Kills of a short fit, each at a random moment
    #[arg(long, default_value_t = 100)]
    kills: u32,
    /// Minutes of the long fit, whose memory must stay flat
    #[arg(long, default_value = "10", value_parser = minutes)]
    minutes: Duration,
    /// Seed of the moments
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The dsdf program [default: it is built]
    #[arg(long)]
    binary: Option<PathBuf>,
}

/// The largest growth of the resident memory between the two windows of a long fit: a twentieth.
const GROWTH: f64 = 1.05;

impl Soak {
    /// Kills and resumes short fits, then watches the memory of a long one. Prints the figures.
    ///
    /// # Errors
    /// If a resumed fit ends with other files, the memory grows, or a program fails.
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let program = self.binary.clone().map_or_else(dsdf::build, Ok)?;
        let folder = tempfile::tempdir()?;
        let data = photographs(&program, folder.path())?;
        if self.kills > 0 {
            let kills = Kills { program: &program, folder: folder.path(), data: &data };
            let report = kills.run(self.kills, self.seed)?;
            println!(
                "{} kills in {} runs, each as the uninterrupted run of {:.1} s in every byte; \
                 {} kills came before the first checkpoint",
                self.kills, report.runs, report.seconds, report.early
            );
        }
        if !self.minutes.is_zero() {
            let [early, late] = long_fit(&program, folder.path(), &data, self.minutes)?;
            let seconds = self.minutes.as_secs();
            println!(
                "{seconds} s of a fit: resident memory {early:.1} MiB from 0.5 to 0.7 of the \
                 time, {late:.1} MiB from 0.8 to 1.0"
            );
            ensure!(late <= GROWTH * early, "the memory grows from {early:.1} to {late:.1} MiB");
        }
        Ok(())
    }
}

/// Renders the photographs of a small scene into `folder`, and returns their folder.
fn photographs(program: &Path, folder: &Path) -> anyhow::Result<String> {
    let scene = json!({
        "camera": {"width": 48, "height": 48, "focal": 80, "principal": [24, 24],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "smooth_union", "k": 0.2, "children": [
            {"type": "sphere", "center": [0.2, 0, 0], "radius": 0.5},
            {"type": "box", "center": [-0.3, 0, 0], "half_size": [0.3, 0.3, 0.3]}]},
        "appearance": {"type": "normal"},
        "background": [0, 0, 0]
    });
    let (file, data) = (folder.join("scene.json"), text(&folder.join("data")));
    fs::write(&file, scene.to_string())?;
    run_json(program, &["synth", &text(&file), "-o", &data, "--views", "9", "--size", "48x48"])?;
    Ok(data)
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Fits that are killed.
struct Kills<'a> {
    program: &'a Path,
    folder: &'a Path,
    /// The folder of the photographs.
    data: &'a str,
}

/// The figures of the killed fits.
struct KillReport {
    /// Runs that were killed once or more, and ended.
    runs: u32,
    /// Wall time of the uninterrupted run, in seconds.
    seconds: f64,
    /// Kills before the first checkpoint: the run starts anew.
    early: u32,
}

/// The options of the short fit. It has 15 checkpoints.
const SHORT_FIT: [&str; 14] = [
    "--iterations",
    "300",
    "--checkpoint-every",
    "20",
    "--preview-every",
    "50",
    "--width",
    "32",
    "--layers",
    "2",
    "--batch",
    "256",
    "--threads",
    "2",
];

/// A run is killed after a random part of the time of the uninterrupted run, up to this.
const LONGEST_PART: f64 = 0.25;

impl Kills<'_> {
    /// Kills runs until there were `kills`. Every run is compared with an uninterrupted one.
    fn run(&self, kills: u32, seed: u64) -> anyhow::Result<KillReport> {
        let whole = self.folder.join("whole");
        let start = Instant::now();
        self.finish(self.fit(&whole, false)?)?;
        let mut report = KillReport { runs: 0, seconds: start.elapsed().as_secs_f64(), early: 0 };
        let (mut random, mut left) = (Random(seed), kills);
        while left > 0 {
            let run = self.folder.join(format!("killed-{}", report.runs));
            left = self.killed_run(&run, left, &mut random, &mut report)?;
            compare(&whole, &run).with_context(|| format!("after {} kills", kills - left))?;
            fs::remove_dir_all(&run)?;
            report.runs += 1;
        }
        Ok(report)
    }

    /// Runs a fit to its end with at most `left` kills. Returns how many are left then.
    fn killed_run(
        &self,
        run: &Path,
        mut left: u32,
        random: &mut Random,
        report: &mut KillReport,
    ) -> anyhow::Result<u32> {
        let has_checkpoint = || run.join("checkpoint/state.safetensors").exists();
        while left > 0 {
            let child = self.fit(run, has_checkpoint())?;
            let moment = random.next() * LONGEST_PART * report.seconds;
            if !self.kill(child, Duration::from_secs_f64(moment))? {
                return Ok(left);
            }
            left -= 1;
            report.early += u32::from(!has_checkpoint());
        }
        self.finish(self.fit(run, has_checkpoint())?)?;
        Ok(0)
    }

    /// Starts or resumes the fit of a run folder.
    fn fit(&self, run: &Path, resume: bool) -> anyhow::Result<Child> {
        let log = File::create(self.folder.join("log"))?;
        let mut command = Command::new(self.program);
        command.arg("fit");
        if resume {
            command.arg("--resume");
        } else {
            command.arg(self.data).args(SHORT_FIT);
        }
        command.arg("-o").arg(run).arg("--quiet");
        Ok(command.stdout(Stdio::null()).stderr(log).spawn()?)
    }

    /// Kills a process at a moment. Returns whether it was still running.
    ///
    /// # Errors
    /// If the process ended before with a failure.
    fn kill(&self, mut child: Child, moment: Duration) -> anyhow::Result<bool> {
        sleep(moment);
        if child.try_wait()?.is_some() {
            self.finish(child)?;
            return Ok(false);
        }
        child.kill()?;
        // A process that ended between the look and the kill has succeeded.
        Ok(!child.wait()?.success())
    }

    /// Waits for the success of a process.
    fn finish(&self, mut child: Child) -> anyhow::Result<()> {
        let status = child.wait()?;
        let log = fs::read_to_string(self.folder.join("log")).unwrap_or_default();
        ensure!(status.success(), "dsdf fit: {status}: {}", log.trim());
        Ok(())
    }
}

/// Compares the files of two run folders.
///
/// All names and all bytes must be equal, but for the wall times in the checkpoint and in
/// `metrics.jsonl`.
fn compare(whole: &Path, run: &Path) -> anyhow::Result<()> {
    let [expected, found] = [whole, run].map(names);
    let (expected, found) = (expected?, found?);
    ensure!(expected == found, "files {found:?}, expected {expected:?}");
    for name in &expected {
        let [a, b] = [whole, run].map(|folder| timeless(&folder.join(name)));
        if let Some(at) = first_difference(&a?, &b?) {
            let path = run.join(name);
            bail!("{}: differs from the uninterrupted run in {at}", path.display());
        }
    }
    Ok(())
}

/// The line of the first difference, with the byte; `None` for equal contents.
fn first_difference(a: &[u8], b: &[u8]) -> Option<String> {
    let equal = a.iter().zip(b).take_while(|(a, b)| a == b).count();
    let line = 1 + a[..equal].iter().filter(|byte| **byte == b'\n').count();
    (a != b).then(|| format!("line {line}, byte {equal}"))
}

/// The names of all files of a folder and of the folders in it, sorted.
fn names(folder: &Path) -> anyhow::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.file_type()?.is_dir() {
            let inner = names_in(&entry.path(), &name)?;
            names.extend(inner);
        } else {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// The names of the files of an inner folder, with its own name before.
fn names_in(folder: &Path, name: &str) -> anyhow::Result<Vec<String>> {
    Ok(names(folder)?.into_iter().map(|inner| format!("{name}/{inner}")).collect())
}

/// The content of a file of a run without wall times.
fn timeless(path: &Path) -> anyhow::Result<Vec<u8>> {
    let bytes = fs::read(path)?;
    match path.file_name().and_then(|name| name.to_str()) {
        Some("metrics.jsonl") => timeless_metrics(&bytes),
        Some("state.safetensors") => timeless_state(&bytes),
        _ => Ok(bytes),
    }
}

/// The lines of `metrics.jsonl` without seconds and rays per second.
fn timeless_metrics(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut out = Vec::new();
    for line in std::str::from_utf8(bytes)?.lines() {
        let mut line: Value = serde_json::from_str(line)?;
        line["seconds"] = Value::Null;
        line["rays_per_second"] = Value::Null;
        out.extend(format!("{line}\n").into_bytes());
    }
    Ok(out)
}

/// The header of a checkpoint, in the order of its keys and without the seconds; then its data.
fn timeless_state(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let length = bytes.first_chunk().map_or(0, |n| u64::from_le_bytes(*n)) as usize;
    let text = bytes.get(8..8 + length).context("the header of a checkpoint")?;
    let mut header: Value = serde_json::from_slice(text)?;
    header["__metadata__"]["seconds"] = Value::Null;
    Ok([header.to_string().as_bytes(), &bytes[8 + length..]].concat())
}

/// Time between two looks at the memory of a process.
const INTERVAL: Duration = Duration::from_millis(200);

/// Runs a fit for a time. Returns the median of its resident memory, in MiB, from 0.5 to 0.7
/// and from 0.8 to 1.0 of the time. Before 0.45, a fit works on smaller images.
fn long_fit(program: &Path, folder: &Path, data: &str, time: Duration) -> anyhow::Result<[f64; 2]> {
    let (budget, run) = (format!("{}ms", time.as_millis()), folder.join("long"));
    let log = folder.join("log");
    let start = Instant::now();
    let mut child = Command::new(program)
        .args(["fit", data, "--quiet", "--time", &budget, "--preview-every", "100", "-o"])
        .arg(&run)
        .stdout(Stdio::null())
        .stderr(File::create(&log)?)
        .spawn()?;
    let mut samples = Vec::new();
    while child.try_wait()?.is_none() {
        let memory = dsdf::memory(child.id(), "VmRSS:");
        let part = start.elapsed().as_secs_f64() / time.as_secs_f64();
        samples.extend(memory.map(|mebibytes| (part, mebibytes)));
        sleep(INTERVAL);
    }
    let status = child.wait()?;
    if !status.success() {
        bail!("dsdf fit: {status}: {}", fs::read_to_string(&log)?.trim());
    }
    Ok([window(&samples, 0.5, 0.7)?, window(&samples, 0.8, 1.0)?])
}

/// The median of the samples in a part of the time.
fn window(samples: &[(f64, f64)], from: f64, to: f64) -> anyhow::Result<f64> {
    let inside = samples.iter().filter(|(part, _)| (from..to).contains(part));
    let mut values: Vec<f64> = inside.map(|(_, mebibytes)| *mebibytes).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().context("the memory of a process, from /proc")
}

/// A sequence of random numbers: G. L. Steele, D. Lea and C. H. Flood, "Fast Splittable
/// Pseudorandom Number Generators", OOPSLA 2014 (SplitMix64).
struct Random(u64);

impl Random {
    /// The next number, uniform in [0, 1).
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run folder with these seconds, this loss and these parameters.
    fn run_folder(seconds: f64, loss: f64, parameters: &[u8]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
        fs::create_dir(folder.path().join("checkpoint")).unwrap();
        write("metrics.jsonl", json!({"seconds": seconds, "loss": loss}).to_string().as_bytes());
        let header = json!({"__metadata__": {"seconds": seconds.to_string(), "iteration": "3"}});
        let header = header.to_string();
        let length = (header.len() as u64).to_le_bytes();
        let state = [&length[..], header.as_bytes(), parameters].concat();
        write("checkpoint/state.safetensors", &state);
        folder
    }

    #[test]
    fn runs_that_differ_in_more_than_their_times_are_told_apart() {
        let whole = run_folder(1.5, 0.1, b"abc");
        let same = |other: &tempfile::TempDir| compare(whole.path(), other.path());
        same(&run_folder(2.25, 0.1, b"abc")).unwrap();
        let error = same(&run_folder(1.5, 0.2, b"abc")).unwrap_err().to_string();
        assert!(error.contains("metrics.jsonl"), "{error}");
        let error = same(&run_folder(1.5, 0.1, b"abd")).unwrap_err().to_string();
        assert!(error.contains("state.safetensors"), "{error}");
        let other = run_folder(1.5, 0.1, b"abc");
        fs::write(other.path().join(".dsdf-1.tmp"), "").unwrap();
        let error = same(&other).unwrap_err().to_string();
        assert!(error.contains(".dsdf-1.tmp"), "{error}");
    }

    #[test]
    fn windows_have_the_median_of_their_part_of_the_time() {
        let samples: Vec<(f64, f64)> =
            (0..100).map(|i| (f64::from(i) / 100.0, f64::from(i))).collect();
        assert_eq!(window(&samples, 0.5, 0.7).unwrap(), 60.0);
        assert_eq!(window(&samples, 0.8, 1.0).unwrap(), 90.0);
        assert!(window(&[], 0.8, 1.0).is_err());
    }
}
