//! A campaign: one reader reads many cases in processes of their own, with limits.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};

use crate::child::{Event, Reading};

/// The limits of each case.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Wall time, in seconds.
    pub seconds: f64,
    /// Address space of the process, in MiB.
    pub mebibytes: u64,
}

impl Default for Limits {
    /// Half a minute and a gibibyte. A case takes milliseconds and some megabytes, but the machine
    /// may have other work.
    fn default() -> Self {
        Limits { seconds: 30.0, mebibytes: 1024 }
    }
}

/// The cases of a campaign.
#[derive(Clone, Copy, Debug)]
pub enum Cases<'a> {
    /// The cases of a seed, as many as this number.
    Count(u64, u64),
    /// The cases of a seed, for this time.
    Time(u64, Duration),
    /// The folders in a folder.
    Kept(&'a Path),
}

/// A fault of a reader.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The number of the first case with it.
    pub case: u64,
    /// `crash`, `time` or `message`.
    pub kind: &'static str,
    /// One line.
    pub message: String,
    /// How many cases have it: those with the same message, apart from numbers.
    pub count: u64,
}

/// The result of a campaign.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Cases that were read.
    pub accepted: u64,
    /// Cases that were refused with one good line.
    pub refused: u64,
    /// The different faults.
    pub findings: Vec<Finding>,
}

impl Tally {
    /// The number of cases.
    pub fn executions(&self) -> u64 {
        self.accepted + self.refused + self.findings.iter().map(|f| f.count).sum::<u64>()
    }

    /// The findings, one line each.
    pub fn describe(&self) -> String {
        let line = |f: &Finding| {
            format!("case {}: {}, {} times: {}\n", f.case, f.kind, f.count, f.message)
        };
        self.findings.iter().map(line).collect()
    }
}

/// One reader of the program `fuzz`.
#[derive(Debug)]
pub struct Campaign<'a> {
    /// The program.
    pub program: &'a Path,
    /// The reader's name.
    pub reader: &'a str,
    /// The limits of each case.
    pub limits: Limits,
    /// The folder that keeps the files of each finding.
    pub keep: Option<&'a Path>,
}

/// Cases that one process reads before it is replaced: memory that leaks is not a finding.
const CASES_OF_A_PROCESS: u64 = 10_000;

/// The longest message of a finding, in characters.
const MAX_FINDING_CHARACTERS: usize = 300;

impl Campaign<'_> {
    /// Reads the cases. A process that crashes or hangs is replaced, and its case is a finding.
    ///
    /// # Errors
    /// If the program cannot be started or fails outside of a case.
    pub fn run(&self, cases: Cases<'_>) -> anyhow::Result<Tally> {
        let folder = tempfile::tempdir()?;
        // A path without links, as messages have it.
        let folder = folder.path().canonicalize().map(|path| (folder, path))?;
        let mut run = Run { campaign: self, cases, folder: &folder.1, tally: Tally::default() };
        let (start, mut first) = (Instant::now(), 0);
        while let Some(next) = run.process(first, start)? {
            first = next;
        }
        Ok(run.tally)
    }
}

/// A running campaign.
struct Run<'a> {
    campaign: &'a Campaign<'a>,
    cases: Cases<'a>,
    /// The folder of the case and of standard error.
    folder: &'a Path,
    tally: Tally,
}

impl Run<'_> {
    /// Reads cases from number `first` in one process. Returns the number of the case with which
    /// the next process starts, or `None` at the end of the campaign.
    fn process(&mut self, first: u64, start: Instant) -> anyhow::Result<Option<u64>> {
        let count = match self.cases {
            Cases::Count(_, count) => count.saturating_sub(first).min(CASES_OF_A_PROCESS),
            _ => CASES_OF_A_PROCESS,
        };
        if count == 0 {
            return Ok(None);
        }
        let log = self.folder.join("stderr");
        let arguments = self.arguments(first, count);
        let mut reading = Reading::start(self.campaign.program, &arguments, &log)?;
        let (mut next, mut inside) = (first, false);
        loop {
            match reading.next(self.campaign.limits.seconds)? {
                Event::Line(line) => {
                    inside = self.line(&line, &mut next)?;
                    if !inside && self.is_over(start) {
                        return Ok(None);
                    }
                }
                Event::Silence if inside => {
                    let message = format!("{} s are over", self.campaign.limits.seconds);
                    self.found(next, "time", &message)?;
                    return Ok(Some(next + 1).filter(|_| !self.is_over(start)));
                }
                Event::End(Some(status)) if inside => {
                    self.found(next, "crash", &format!("{status}: {}", last_words(&log)))?;
                    return Ok(Some(next + 1).filter(|_| !self.is_over(start)));
                }
                // A process also ends after a wrong message, so that the files of its case stay.
                Event::End(None) if !inside => return Ok(Some(next).filter(|_| next > first)),
                // The generation of a case has the same limit of time.
                event => {
                    bail!("{}: case {next}: {event:?}: {}", self.campaign.reader, last_words(&log))
                }
            }
        }
    }

    fn arguments(&self, first: u64, count: u64) -> Vec<String> {
        let (command, source) = match self.cases {
            Cases::Count(seed, _) | Cases::Time(seed, _) => ("cases", seed.to_string()),
            Cases::Kept(folder) => ("kept", folder.display().to_string()),
        };
        let (reader, folder) = (self.campaign.reader, self.folder.display().to_string());
        let memory = self.campaign.limits.mebibytes.to_string();
        let texts = [command, reader, &folder, &memory, &source];
        let texts = texts.into_iter().map(str::to_owned);
        texts.chain([first.to_string(), count.to_string()]).collect()
    }

    /// Whether the time of the campaign is over.
    fn is_over(&self, start: Instant) -> bool {
        matches!(self.cases, Cases::Time(_, time) if start.elapsed() >= time)
    }

    /// Takes a line of the process into account. Returns whether a case is being read, and moves
    /// `next` to it, or behind it.
    fn line(&mut self, line: &str, next: &mut u64) -> anyhow::Result<bool> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "case" => {
                *next = rest.parse().context("the number of a case")?;
                return Ok(true);
            }
            "accepted" => self.tally.accepted += 1,
            "refused" => self.tally.refused += 1,
            "wrong" => self.found(*next, "message", rest)?,
            _ => bail!("{}: unexpected line {line:?}", self.campaign.reader),
        }
        *next += 1;
        Ok(false)
    }

    /// Adds a finding, and keeps the files of its case if it is new.
    fn found(&mut self, case: u64, kind: &'static str, message: &str) -> anyhow::Result<()> {
        let message = message.replace(&self.folder.display().to_string(), "");
        let message: String = message.chars().take(MAX_FINDING_CHARACTERS).collect();
        let known = |f: &&mut Finding| f.kind == kind && pattern(&f.message) == pattern(&message);
        if let Some(finding) = self.tally.findings.iter_mut().find(known) {
            finding.count += 1;
            return Ok(());
        }
        if let Some(keep) = self.campaign.keep {
            let name = match self.cases {
                Cases::Count(seed, _) | Cases::Time(seed, _) => format!("{seed}-{case}"),
                Cases::Kept(_) => format!("kept-{case}"),
            };
            let folder = keep.join(self.campaign.reader).join(name);
            copy(&self.folder.join("case"), &folder)?;
            fs::write(folder.with_extension("txt"), format!("{kind}: {message}\n"))?;
        }
        self.tally.findings.push(Finding { case, kind, message, count: 1 });
        Ok(())
    }
}

/// A message without its numbers and without its values: equal for equal faults.
fn pattern(message: &str) -> String {
    let start = message.split("found ").next().unwrap_or_default();
    start.chars().filter(|c| c.is_ascii_alphabetic()).take(120).collect()
}

/// The first line of standard error that is no empty line, with the one after it: the message of a
/// panic has two.
fn last_words(log: &Path) -> String {
    let text = fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).into_owned();
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).take(2).collect();
    lines.join(" ")
}

/// Copies the regular files of a folder, and of the folders in it. Links and pipes have only their
/// names kept, in a file with the ending `.special`.
fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let (path, kind) = (to.join(entry.file_name()), entry.file_type()?);
        if kind.is_dir() {
            copy(&entry.path(), &path)?;
        } else if kind.is_file() {
            fs::copy(entry.path(), &path)?;
        } else {
            let target = fs::read_link(entry.path());
            let text = target.map_or("a pipe".into(), |t| format!("a link to {}", t.display()));
            let mut name = path.into_os_string();
            name.push(".special");
            fs::write(name, text)?;
        }
    }
    Ok(())
}
