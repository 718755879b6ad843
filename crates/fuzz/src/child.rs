//! A process that reads cases and prints lines about them.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::Context;

/// The next event of a process.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// A line that it printed.
    Line(String),
    /// It has ended; with its exit status, as text, unless that is success.
    End(Option<String>),
    /// It has printed nothing for the given time.
    Silence,
}

/// A running process, which is killed when this is dropped.
pub(crate) struct Reading {
    child: Child,
    lines: Receiver<String>,
}

impl Reading {
    /// Starts a program, with standard error in the file `log`.
    ///
    /// # Errors
    /// If it cannot be started.
    pub(crate) fn start(program: &Path, arguments: &[String], log: &Path) -> anyhow::Result<Self> {
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(File::create(log)?)
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let output = child.stdout.take().context("standard output")?;
        let (sender, lines) = channel();
        // The thread ends with the process, or at the first line after this is dropped.
        std::thread::spawn(move || {
            for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
                if sender.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                    break;
                }
            }
        });
        Ok(Reading { child, lines })
    }

    /// Waits for the next event, for `seconds` at most.
    ///
    /// # Errors
    /// If the system does not tell how the process ended.
    pub(crate) fn next(&mut self, seconds: f64) -> anyhow::Result<Event> {
        match self.lines.recv_timeout(Duration::from_secs_f64(seconds)) {
            Ok(line) => Ok(Event::Line(line)),
            Err(RecvTimeoutError::Timeout) => Ok(Event::Silence),
            Err(RecvTimeoutError::Disconnected) => {
                let status = self.child.wait()?;
                Ok(Event::End((!status.success()).then(|| status.to_string())))
            }
        }
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
