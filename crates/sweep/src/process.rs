//! Programs run with a limit on time and memory.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::Value;

use super::tables::Limits;

/// Why a program did not do what it should.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{reason}")]
pub(super) struct Failure {
    /// `failed`, `time` or `memory`.
    pub(super) status: &'static str,
    pub(super) reason: String,
}

impl Failure {
    /// Of a program that took longer than it may.
    pub(super) fn time(limit: f64) -> Self {
        Failure { status: "time", reason: format!("{limit} s are over") }
    }
}

/// A program with limits, for commands in a row.
pub(super) struct Limited<'a> {
    pub(super) program: &'a Path,
    pub(super) limits: &'a Limits,
    pub(super) log: &'a Path,
}

impl measure::dsdf::Run for Limited<'_> {
    fn report(&self, arguments: &[&str]) -> anyhow::Result<Value> {
        let arguments: Vec<String> = arguments.iter().map(|&a| a.to_owned()).collect();
        Ok(run(self.program, &arguments, self.limits, self.log, &|| {})??)
    }
}

/// What ended a program is no doing of its own.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Fault(String);

/// Whether an error is none of a cell's: a fault, or files that cannot be read or written. That one
/// is missing is the cell's own.
pub(super) fn is_fault(error: &anyhow::Error) -> bool {
    let system = error.root_cause().downcast_ref::<std::io::Error>();
    error.is::<Fault>() || system.is_some_and(|e| e.kind() != std::io::ErrorKind::NotFound)
}

/// Errors of the system that say nothing of what was run: input and output, threads, files open,
/// space, read-only, stale, quota.
const MACHINE: [i32; 8] = [5, 11, 23, 24, 28, 30, 116, 122];

/// Whether a message is of such an error.
fn of_the_machine(message: &str) -> bool {
    cfg!(unix) && MACHINE.iter().any(|code| message.contains(&format!("(os error {code})")))
}

/// The exit status of `dsdf` when it was asked to stop.
const INTERRUPTED: i32 = 130;

/// How often a program is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// Runs `program` and reads the JSON object that it prints. What it says otherwise goes to `log`;
/// `watch` is called all the while.
///
/// # Errors
/// If the program cannot be started, or a disk is full. What it does otherwise is a result.
pub(super) fn run(
    program: &Path,
    arguments: &[String],
    limits: &Limits,
    log: &Path,
    watch: &dyn Fn(),
) -> anyhow::Result<Result<Value, Failure>> {
    // A new file each time: what a killed sweep left running writes to its own.
    let out_path = log.with_extension("out");
    let _ = std::fs::remove_file(&out_path);
    let out = File::create(&out_path).with_context(|| out_path.display().to_string())?;
    let mut child = Command::new(program)
        .args(arguments)
        .args(["--json", "--quiet", &format!("--end-with={}", std::process::id())])
        .stdin(Stdio::null())
        .stdout(out)
        .stderr(File::create(log)?)
        .spawn()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let used = measure::dsdf::memory(child.id(), "VmRSS:");
        let seconds = start.elapsed().as_secs_f64();
        let over = if seconds > limits.seconds {
            Some(Failure::time(limits.seconds))
        } else {
            let over = used.filter(|used| *used > limits.mebibytes);
            over.map(|used| Failure {
                status: "memory",
                reason: format!("{used:.0} MiB of {} in use", limits.mebibytes),
            })
        };
        if let Some(failure) = over {
            child.kill()?;
            child.wait()?;
            return Ok(Err(failure));
        }
        watch();
        std::thread::sleep(LOOK);
    };
    let text = String::from_utf8_lossy(&std::fs::read(&out_path)?).into_owned();
    std::fs::remove_file(&out_path)?;
    if status.success() {
        return Ok(serde_json::from_str(&text)
            .map_err(|e| Failure { status: "failed", reason: e.to_string() }));
    }
    let errors = String::from_utf8_lossy(&std::fs::read(log).unwrap_or_default()).into_owned();
    let last = errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("no message");
    // The parameters are not to blame: the cell is run again.
    let blamed = errors.lines().find(|line| of_the_machine(line));
    let interrupted = (status.code() == Some(INTERRUPTED)).then_some("interrupted");
    if let Some(said) = blamed.or(interrupted) {
        return Err(Fault(format!("{}: {said}", log.display())).into());
    }
    Ok(Err(Failure { status: "failed", reason: format!("{status}: {last}") }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, limits: Limits) -> Result<Value, Failure> {
        let folder = tempfile::tempdir().unwrap();
        let arguments = ["-c".to_owned(), script.to_owned()];
        run(Path::new("sh"), &arguments, &limits, &folder.path().join("log"), &|| {}).unwrap()
    }

    #[test]
    fn limits_end_a_program_and_what_it_says_is_kept() {
        let limits = Limits { seconds: 0.2, mebibytes: 1000.0 };
        assert_eq!(shell("echo '{\"a\": 1}'", limits).unwrap()["a"], 1);
        assert_eq!(shell("sleep 10", limits).unwrap_err().status, "time");
        let failure = shell("echo one >&2; echo two >&2; exit 3", limits).unwrap_err();
        assert!(failure.status == "failed" && failure.reason.ends_with(": two"), "{failure:?}");
        assert_eq!(shell("echo nonsense", limits).unwrap_err().status, "failed");
        // Also through what reads its report.
        let folder = tempfile::tempdir().unwrap();
        let program =
            Limited { program: Path::new("sh"), limits: &limits, log: &folder.path().join("log") };
        for script in ["echo 'No space left (os error 28)' >&2; echo note >&2; exit 1", "exit 130"]
        {
            let error = measure::dsdf::Run::report(&program, &["-c", script]).unwrap_err();
            assert!(is_fault(&error.context("gradient")), "{script}");
        }
        let own = measure::dsdf::Run::report(&program, &["-c", "exit 3"]).unwrap_err();
        assert!(!is_fault(&own), "{own}");
        assert!(of_the_machine("error: run: No space left on device (os error 28)"));
        assert!(!of_the_machine("error: run: No such file or directory (os error 2)"));
        if cfg!(target_os = "linux") {
            let small = Limits { seconds: 10.0, mebibytes: 0.1 };
            assert_eq!(shell("sleep 5", small).unwrap_err().status, "memory");
        }
    }
}
