//! The program of a campaign: generates cases and reads them, one after the other. `fuzz::campaign`
//! starts it with limits, and starts it again after a crash.
//!
//! `fuzz cases READER FOLDER MEBIBYTES SEED FIRST COUNT` generates cases in FOLDER.
//! `fuzz kept READER FOLDER MEBIBYTES CORPUS FIRST COUNT` takes them from the folders of CORPUS.
//! Before each case it prints `case N`, after it `accepted`, `refused` or `wrong MESSAGE`. After a
//! wrong message it ends.
//! `fuzz campaigns SECONDS SEED OUTPUT CORPUS [READER]` runs campaigns of these processes.
//! `fuzz dsdf ARGUMENTS` is `dsdf`, and `fuzz readers` lists the readers.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program")]

mod campaigns;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};

use fuzz::{DSDF, READERS, Reader, Verdict, reader, write_case};

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == DSDF) {
        return ExitCode::from(app::cli::run(arguments.into_iter().map(Into::into)));
    }
    arguments.resize(7, String::new());
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &[String]) -> anyhow::Result<()> {
    if arguments[0] == "readers" {
        READERS.iter().for_each(|reader| println!("{}", reader.name));
        return Ok(());
    }
    if arguments[0] == "campaigns" {
        return campaigns::run(&campaigns::Options {
            time: Duration::try_from_secs_f64(arguments[1].parse().context("seconds")?)?,
            seed: arguments[2].parse().context("a seed")?,
            output: arguments[3].clone().into(),
            corpus: arguments[4].clone().into(),
            reader: arguments[5].clone(),
        });
    }
    let reader = reader(&arguments[1]).with_context(|| format!("no reader {}", arguments[1]))?;
    let folder = Path::new(&arguments[2]);
    limit_memory(arguments[3].parse().context("MiB of memory")?)?;
    // The number of threads decides how much address space their stacks take.
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global()?;
    let first: u64 = arguments[5].parse().context("the first case")?;
    let cases = first..first + arguments[6].parse::<u64>().context("a number of cases")?;
    match arguments[0].as_str() {
        "cases" => {
            let seed = arguments[4].parse().context("a seed")?;
            run_cases(reader, folder, cases, |n, folder| write_case(reader, seed, n, folder))
        }
        "kept" => {
            let kept = kept_cases(Path::new(&arguments[4]))?;
            let cases = first..cases.end.min(kept.len() as u64);
            run_cases(reader, folder, cases, |n, folder| copy(&kept[n as usize], folder))
        }
        other => bail!("no command {other}"),
    }
}

/// Limits the address space. The processes that this one starts have the same limit.
#[cfg(unix)]
fn limit_memory(mebibytes: u64) -> anyhow::Result<()> {
    use rustix::process::{Resource, Rlimit, setrlimit};
    let limit = |bytes| Rlimit { current: Some(bytes), maximum: Some(bytes) };
    setrlimit(Resource::As, limit(mebibytes << 20))?;
    // An abort is a finding; its memory image is of no use.
    Ok(setrlimit(Resource::Core, limit(0))?)
}

#[cfg(not(unix))]
fn limit_memory(_mebibytes: u64) -> anyhow::Result<()> {
    Ok(())
}

/// Writes each case into a new folder `case` of `folder`, reads it, and prints the verdict. A wrong
/// message is the last one.
fn run_cases(
    reader: &Reader,
    folder: &Path,
    cases: std::ops::Range<u64>,
    write: impl Fn(u64, &Path) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let folder = folder.join("case");
    for n in cases {
        if folder.exists() {
            fs::remove_dir_all(&folder)?;
        }
        fs::create_dir_all(&folder)?;
        write(n, &folder)?;
        println!("case {n}");
        match reader.read(&folder)? {
            Verdict::Accepted => println!("accepted"),
            Verdict::Refused => println!("refused"),
            // The files of the case stay for the driver.
            Verdict::Wrong(message) => {
                println!("wrong {}", message.escape_debug());
                break;
            }
        }
    }
    Ok(())
}

/// The folders of kept cases in the order of their names; none if there is no such folder.
fn kept_cases(corpus: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !corpus.exists() {
        return Ok(Vec::new());
    }
    let mut folders: Vec<PathBuf> = fs::read_dir(corpus)?.flatten().map(|e| e.path()).collect();
    folders.sort();
    Ok(folders)
}

/// Copies the files of a folder, and of the folders in it.
fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let target = to.join(path.file_name().context("a name")?);
        if path.is_dir() {
            fs::create_dir_all(&target)?;
            copy(&path, &target)?;
        } else {
            fs::copy(&path, &target)?;
        }
    }
    Ok(())
}
