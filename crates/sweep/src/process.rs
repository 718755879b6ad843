//! Programs with limits on time and memory.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::error::{Error, ProcessFailure};
use crate::report::schema::Limits;
use serde_json::Value;

/// Why a stage of a cell has no result.
#[derive(Debug)]
pub(crate) enum StageError {
    /// The cell failed: the sweep records it and goes on.
    Cell(ProcessFailure),
    /// The machine or the user interrupted the cell: the sweep ends, and runs the cell again when
    /// it is continued.
    Sweep(Error),
}

impl StageError {
    /// The error without the distinction.
    pub(crate) fn into_error(self) -> Error {
        match self {
            StageError::Cell(failure) => failure.into(),
            StageError::Sweep(error) => error,
        }
    }
}

impl From<ProcessFailure> for StageError {
    fn from(failure: ProcessFailure) -> Self {
        StageError::Cell(failure)
    }
}

impl From<Error> for StageError {
    fn from(error: Error) -> Self {
        StageError::Sweep(error)
    }
}

impl From<std::io::Error> for StageError {
    fn from(error: std::io::Error) -> Self {
        StageError::Sweep(error.into())
    }
}

/// A program with limits that runs `dsdf` commands one after the other.
pub(crate) struct LimitedProgram<'a> {
    pub(crate) program: &'a Path,
    pub(crate) limits: &'a Limits,
    /// The file for standard error of the latest command.
    pub(crate) log: &'a Path,
}

impl crate::measure::dsdf::RunDsdf for LimitedProgram<'_> {
    fn run_json(&self, arguments: &[&str]) -> Result<Value, Error> {
        let arguments: Vec<String> = arguments.iter().map(|&a| a.to_owned()).collect();
        run(self.program, &arguments, self.limits, self.log, &|| {}).map_err(StageError::into_error)
    }
}

/// Numbers of Unix system errors that depend on the machine, not on the program: input or output
/// (5), no more processes or threads (11), too many open files (23, 24), no space (28), read-only
/// file system (30), stale file handle (116), disk quota (122).
const MACHINE_ERRORS: [i32; 8] = [5, 11, 23, 24, 28, 30, 116, 122];

/// Whether a line of standard error names such an error.
fn names_machine_error(line: &str) -> bool {
    cfg!(unix) && MACHINE_ERRORS.iter().any(|code| line.contains(&format!("(os error {code})")))
}

/// The exit status of `dsdf` after an interruption by a signal.
const INTERRUPTED: i32 = 130;

/// Time between two looks at a running program.
const INTERVAL: Duration = Duration::from_millis(20);

/// Runs `program` with limits and reads the JSON that it prints. Standard error goes to the file
/// `log`. `watch` is called every 20 ms while the program runs.
///
/// The program ends with this process: it gets the option `--end-with`.
///
/// # Errors
/// [`StageError::Cell`] if the program fails, exceeds a limit or prints no JSON.
/// [`StageError::Sweep`] if it cannot start, is interrupted, or fails by a fault of the machine.
pub(crate) fn run(
    program: &Path,
    arguments: &[String],
    limits: &Limits,
    log: &Path,
    watch: &dyn Fn(),
) -> Result<Value, StageError> {
    let out = log.with_extension("out");
    let mut child = start(program, arguments, &out, log)?;
    let status = wait_within(&mut child, limits, watch)?;
    let text = String::from_utf8_lossy(&std::fs::read(&out)?).into_owned();
    std::fs::remove_file(&out)?;
    if status.success() {
        let json = serde_json::from_str(&text);
        return Ok(json.map_err(|e| ProcessFailure::failed(e.to_string()))?);
    }
    Err(failure(status, log))
}

/// Starts the program with standard output in the file `out` and standard error in the file `log`.
fn start(program: &Path, arguments: &[String], out: &PathBuf, log: &Path) -> Result<Child, Error> {
    // A new file each time: a program that outlived a killed sweep still writes to the old one.
    let _ = std::fs::remove_file(out);
    let file = File::create(out).map_err(Error::file(out))?;
    Command::new(program)
        .args(arguments)
        .args(["--json", "--quiet", &format!("--end-with={}", std::process::id())])
        .stdin(Stdio::null())
        .stdout(file)
        .stderr(File::create(log)?)
        .spawn()
        .map_err(Error::action(format!("cannot start {}", program.display())))
}

/// Waits for the end of a program, and kills it when it exceeds a limit.
fn wait_within(
    child: &mut Child,
    limits: &Limits,
    watch: &dyn Fn(),
) -> Result<ExitStatus, StageError> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if let Some(failure) = exceeded(child.id(), start.elapsed().as_secs_f64(), limits) {
            child.kill()?;
            child.wait()?;
            return Err(failure.into());
        }
        watch();
        std::thread::sleep(INTERVAL);
    }
}

/// The limit that a running process exceeds after these seconds.
fn exceeded(process: u32, seconds: f64, limits: &Limits) -> Option<ProcessFailure> {
    if seconds > limits.seconds {
        return Some(ProcessFailure::time(limits.seconds));
    }
    let used =
        crate::measure::dsdf::memory(process, "VmRSS:").filter(|used| *used > limits.mebibytes)?;
    let reason = format!("{used:.0} MiB of {} in use", limits.mebibytes);
    Some(ProcessFailure { status: "memory", reason })
}

/// The error of a program that ended with this status, from its standard error in the file `log`.
fn failure(status: ExitStatus, log: &Path) -> StageError {
    let errors = String::from_utf8_lossy(&std::fs::read(log).unwrap_or_default()).into_owned();
    let fault = errors.lines().find(|line| names_machine_error(line));
    let interrupted = (status.code() == Some(INTERRUPTED)).then_some("interrupted");
    if let Some(message) = fault.or(interrupted) {
        return StageError::Sweep(Error::Fault(format!("{}: {message}", log.display())));
    }
    let last = errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("no message");
    ProcessFailure::failed(format!("{status}: {last}")).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { seconds: 0.2, mebibytes: 1000.0 };

    fn shell(script: &str, limits: Limits) -> Result<Value, ProcessFailure> {
        let folder = tempfile::tempdir().unwrap();
        let arguments = ["-c".to_owned(), script.to_owned()];
        run(Path::new("sh"), &arguments, &limits, &folder.path().join("log"), &|| {}).map_err(|e| {
            match e {
                StageError::Cell(failure) => failure,
                StageError::Sweep(error) => panic!("{error}"),
            }
        })
    }

    #[test]
    fn limits_end_a_program_and_its_last_message_is_the_reason() {
        let limits = LIMITS;
        assert_eq!(shell("echo '{\"a\": 1}'", limits).unwrap()["a"], 1);
        assert_eq!(shell("sleep 10", limits).unwrap_err().status, "time");
        let failure = shell("echo one >&2; echo two >&2; exit 3", limits).unwrap_err();
        assert!(failure.status == "failed" && failure.reason.ends_with(": two"), "{failure:?}");
        assert_eq!(shell("echo nonsense", limits).unwrap_err().status, "failed");
        if cfg!(target_os = "linux") {
            let small = Limits { seconds: 10.0, mebibytes: 0.1 };
            assert_eq!(shell("sleep 5", small).unwrap_err().status, "memory");
        }
    }

    #[test]
    fn faults_of_the_machine_are_told_from_failures_of_the_program() {
        use crate::measure::dsdf::RunDsdf;
        let folder = tempfile::tempdir().unwrap();
        let (program, log) = (Path::new("sh"), folder.path().join("log"));
        let program = LimitedProgram { program, limits: &LIMITS, log: &log };
        for script in ["echo 'No space left (os error 28)' >&2; echo note >&2; exit 1", "exit 130"]
        {
            let error = program.run_json(&["-c", script]).unwrap_err();
            assert!(error.is_fault(), "{script}");
        }
        let own = program.run_json(&["-c", "exit 3"]).unwrap_err();
        assert!(!own.is_fault(), "{own}");
        assert!(names_machine_error("error: run: No space left on device (os error 28)"));
        assert!(!names_machine_error("error: run: No such file or directory (os error 2)"));
    }
}
