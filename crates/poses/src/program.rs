//! The program COLMAP: its version, its options, and its runs.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, PipeReader};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

use files::{InputError, WriteError};

use crate::Error;

/// Ways to get COLMAP.
const HOW_TO_GET: &str = "install it by `apt install colmap` (Debian, Ubuntu), `brew install \
    colmap` (macOS) or `conda install -c conda-forge colmap`, or give its place by --colmap";

/// The time between two looks at a request to stop.
const LOOK: Duration = Duration::from_millis(50);

/// The program.
#[derive(Clone, Debug)]
pub struct Program {
    /// Its path, or its name on the search path.
    path: PathBuf,
    /// Whether a person gave the path.
    is_given: bool,
}

impl Default for Program {
    fn default() -> Self {
        Program { path: "colmap".into(), is_given: false }
    }
}

/// The end of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// Success.
    Done,
    /// The caller asked for it, or the program got Ctrl-C itself.
    Stopped,
    /// An exit status other than 0, or a signal, in words.
    Failed(String),
}

/// The options that a command of COLMAP lists in its help.
#[derive(Clone, Debug)]
pub(crate) struct Help {
    command: String,
    options: BTreeSet<String>,
}

impl Help {
    /// The options in the text of the help of `command`.
    pub(crate) fn new(command: &str, text: &str) -> Self {
        let options = text.split_whitespace().filter_map(|word| word.strip_prefix("--"));
        Help { command: command.to_owned(), options: options.map(str::to_owned).collect() }
    }

    pub(crate) fn command(&self) -> &str {
        &self.command
    }

    /// Whether the command has an option.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.options.contains(name)
    }
}

impl Program {
    /// The program at `path`.
    pub fn at(path: PathBuf) -> Self {
        Program { path, is_given: true }
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.path);
        // Without a screen, the library of its windows would end the program.
        command.env("QT_QPA_PLATFORM", "offscreen").stdin(Stdio::null());
        command
    }

    /// The error of a program that cannot be started.
    fn not_started(&self, error: std::io::Error) -> Error {
        let path = self.path.display();
        match error.kind() {
            kind if self.is_given => {
                let found = match kind {
                    ErrorKind::NotFound => "no such program".to_owned(),
                    _ => format!("no program that can be started ({error})"),
                };
                InputError::new(&self.path, "--colmap", found, "the program COLMAP").into()
            }
            ErrorKind::NotFound => {
                let text = "found no such program, expected COLMAP";
                Error::Colmap(format!("{path}: {text}: {HOW_TO_GET}"))
            }
            _ => Error::system(format!("start {path}"))(error),
        }
    }

    /// Both outputs of a short run, as text.
    fn text_of(&self, arguments: &[&str]) -> Result<String, Error> {
        let output = self.command().args(arguments).output().map_err(|e| self.not_started(e))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Ok(text(&output.stdout) + &text(&output.stderr))
    }

    /// The version, for example `3.8`.
    ///
    /// # Errors
    /// If the program cannot be started, or is not COLMAP.
    pub(crate) fn version(&self) -> Result<String, Error> {
        let text = self.text_of(&["help"])?;
        let after = text.split_once("COLMAP ").map(|(_, rest)| rest);
        let version = after.and_then(|rest| rest.split_whitespace().next());
        match version.filter(|version| version.starts_with(|c: char| c.is_ascii_digit())) {
            Some(version) => Ok(version.to_owned()),
            None => {
                let found = text.lines().find(|line| !line.trim().is_empty()).unwrap_or("no text");
                let expected = "the help of COLMAP with its version";
                Err(InputError::new(&self.path, "help", found, expected).into())
            }
        }
    }

    /// The options of a command.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub(crate) fn help(&self, command: &str) -> Result<Help, Error> {
        Ok(Help::new(command, &self.text_of(&[command, "-h"])?))
    }

    /// Runs a command. `line` gets each line of both outputs. The run is ended when `stop` is true.
    ///
    /// `lock` is a locked file that the program gets as its input: the lock lasts as long as the
    /// program, also if this process is killed.
    ///
    /// # Errors
    /// If the program cannot be started, or by `line`.
    pub(crate) fn run(
        &self,
        arguments: &[String],
        lock: &File,
        stop: &dyn Fn() -> bool,
        line: &mut dyn FnMut(&str) -> Result<(), WriteError>,
    ) -> Result<End, Error> {
        let pipe = || Error::system("make a pipe");
        let (reader, writer) = std::io::pipe().map_err(pipe())?;
        let mut command = self.command();
        command.stdin(lock.try_clone().map_err(Error::system("share the lock"))?);
        command.args(arguments).stdout(writer.try_clone().map_err(pipe())?).stderr(writer);
        let mut child = command.spawn().map_err(|e| self.not_started(e))?;
        // The pipe ends when the child's copies of its writer are closed, and there is no other.
        drop(command);
        let (sender, receiver) = channel();
        std::thread::spawn(move || send_lines(reader, &sender));
        match follow(&receiver, stop, line) {
            Ok(true) => Ok(end_of(child.wait().map_err(Error::system("wait for COLMAP"))?)),
            ended => {
                end(&mut child);
                ended?;
                Ok(End::Stopped)
            }
        }
    }
}

/// Sends the lines of a pipe until it ends.
fn send_lines(reader: PipeReader, sender: &Sender<String>) {
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
        let text = String::from_utf8_lossy(&line).trim_end().to_owned();
        line.clear();
        if sender.send(text).is_err() {
            return;
        }
    }
}

/// Gives all lines to `line`. Returns whether the lines ended before `stop` was true.
fn follow(
    receiver: &Receiver<String>,
    stop: &dyn Fn() -> bool,
    line: &mut dyn FnMut(&str) -> Result<(), WriteError>,
) -> Result<bool, WriteError> {
    loop {
        if stop() {
            return Ok(false);
        }
        match receiver.recv_timeout(LOOK) {
            Ok(text) => line(&text)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(true),
        }
    }
}

/// Ends a process. It may have ended already.
fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// The signal of Ctrl-C.
#[cfg(unix)]
const INTERRUPT: i32 = 2;

/// The signal by which the system ends a process that needs too much memory.
#[cfg(unix)]
const KILL: i32 = 9;

/// The end of a process that exited.
#[cfg(unix)]
fn end_of(status: ExitStatus) -> End {
    use std::os::unix::process::ExitStatusExt;
    match (status.signal(), status.code()) {
        (Some(INTERRUPT), _) => End::Stopped,
        (Some(KILL), _) => {
            let remedy = "the memory may not suffice: try --max-size 1600 or --threads 1";
            End::Failed(format!("was killed ({remedy})"))
        }
        (Some(signal), _) => End::Failed(format!("ended by signal {signal}")),
        (None, Some(0)) => End::Done,
        (None, code) => End::Failed(format!("ended with status {}", code.unwrap_or(-1))),
    }
}

/// The end of a process that exited.
#[cfg(not(unix))]
fn end_of(status: ExitStatus) -> End {
    if status.success() { End::Done } else { End::Failed(format!("ended with {status}")) }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt;

    use super::*;

    fn shell() -> Program {
        Program::at("sh".into())
    }

    fn run(script: &str, stop: &dyn Fn() -> bool) -> (End, Vec<String>) {
        let mut lines = Vec::new();
        let arguments = ["-c".to_owned(), script.to_owned()];
        let lock = tempfile::tempfile().unwrap();
        let end = shell().run(&arguments, &lock, stop, &mut |line| {
            lines.push(line.to_owned());
            Ok(())
        });
        (end.unwrap(), lines)
    }

    #[test]
    fn lines_of_both_outputs_and_the_end_are_known() {
        let (end, lines) = run("echo a; echo b >&2; printf 'c\\351'", &|| false);
        assert_eq!((end, lines), (End::Done, vec!["a".into(), "b".into(), "c\u{fffd}".into()]));
        let failed = End::Failed("ended with status 7".to_owned());
        assert_eq!(run("exit 7", &|| false).0, failed);
        // A shell that started with this signal ignored would not end by it.
        assert_eq!(end_of(ExitStatus::from_raw(INTERRUPT)), End::Stopped);
        let End::Failed(text) = run("kill -KILL $$", &|| false).0 else { panic!("not failed") };
        assert!(text.contains("--max-size"), "{text}");
    }

    #[test]
    fn a_request_to_stop_ends_the_program_at_once() {
        let start = std::time::Instant::now();
        let stop = || start.elapsed() > Duration::from_millis(200);
        let (end, lines) = run("echo a; exec sleep 100", &stop);
        assert_eq!((end, lines), (End::Stopped, vec!["a".to_owned()]));
        assert!(start.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn the_lock_lasts_as_long_as_the_program() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let lock = files::lock(&path).unwrap().unwrap();
        let mut child =
            Command::new("sleep").arg("100").stdin(lock.try_clone().unwrap()).spawn().unwrap();
        drop(lock);
        assert!(files::lock(&path).unwrap().is_none());
        end(&mut child);
        assert!(files::lock(&path).unwrap().is_some());
    }

    #[test]
    fn a_missing_program_and_another_program_are_told_apart() {
        let missing = Program { path: "no-such-colmap".into(), is_given: false };
        let error = missing.version().unwrap_err();
        assert!(error.input().is_none());
        assert!(error.to_string().contains("apt install colmap"), "{error}");
        let given = Program::at("/no/such/colmap".into()).version().unwrap_err();
        assert!(given.input().is_some());
        let folder = Program::at("/".into()).version().unwrap_err();
        assert!(folder.input().is_some(), "{folder}");
        let other = Program::at("true".into()).version().unwrap_err().to_string();
        assert!(other.contains("found no text, expected the help of COLMAP"), "{other}");
    }
}
