//! The commands of `dsdf`, in this process.

use std::ffi::OsString;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{current, park_timeout, spawn};
use std::time::Duration;

use app::messages::Host;
use pyo3::prelude::*;

use crate::failure::of_anyhow;
use crate::pool;

/// The time between two looks at the progress and at signals.
const PERIOD: Duration = Duration::from_millis(50);

/// The state that a command on a thread of its own shares with the thread that called it.
#[derive(Default)]
struct Shared {
    /// The latest progress that nobody has seen: fraction and text.
    progress: Mutex<Option<(f64, String)>>,
    /// The lines that nobody has seen.
    lines: Mutex<Vec<String>>,
    result: Mutex<Option<String>>,
    /// Whether the command shall stop.
    stops: AtomicBool,
    /// Whether the command is over.
    ended: AtomicBool,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Host for Shared {
    fn result(&self, json: &str) {
        *locked(&self.result) = Some(json.to_owned());
    }

    fn line(&self, line: &str) {
        locked(&self.lines).push(line.to_owned());
    }

    fn progress(&self, step: &str, fraction: f64, text: &dyn Fn() -> String) {
        let mut latest = locked(&self.progress);
        // One text in each period is enough.
        let text = match latest.take() {
            Some((_, text)) => text,
            None => match text() {
                text if text.is_empty() => step.to_owned(),
                text => format!("{step}: {text}"),
            },
        };
        *latest = Some((fraction, text));
    }

    fn is_interrupted(&self) -> bool {
        self.stops.load(Ordering::SeqCst)
    }
}

/// Runs `dsdf` with these arguments, without the name of the program. Returns the result as JSON,
/// or `None` for a command without one.
///
/// `progress` is called with a fraction, 0 to 1, and a text, at most about twenty times a second.
/// `line` is called with each warning or note. An exception of either, and a signal whose handler
/// raises one (Ctrl-C), stops the command; the exception passes through.
#[pyfunction]
pub(crate) fn run(
    py: Python<'_>,
    arguments: Vec<OsString>,
    progress: Option<Py<PyAny>>,
    line: Py<PyAny>,
) -> PyResult<Option<String>> {
    let shared = Arc::new(Shared::default());
    let (host, caller) = (Arc::clone(&shared), current());
    let command = spawn(move || {
        let arguments = std::iter::once("dsdf".into()).chain(arguments);
        let shown = Arc::clone(&host) as Arc<dyn Host>;
        let result = pool::run(|| app::cli::run_in_host(arguments, shown));
        host.ended.store(true, Ordering::SeqCst);
        caller.unpark();
        result
    });
    let is_over = || shared.ended.load(Ordering::SeqCst) || command.is_finished();
    let told = Callbacks { shared: &shared, progress, line }.until(py, is_over);
    let result = py.detach(|| command.join()).unwrap_or_else(|panic| resume_unwind(panic));
    told?;
    result.map_err(|error| of_anyhow(&error))?;
    Ok(locked(&shared.result).take())
}

/// The functions that the thread of the caller calls while it waits.
struct Callbacks<'a> {
    shared: &'a Shared,
    progress: Option<Py<PyAny>>,
    line: Py<PyAny>,
}

impl Callbacks<'_> {
    /// Waits for the end of the command. After an exception, asks it to stop, and waits.
    fn until(&self, py: Python<'_>, is_over: impl Fn() -> bool) -> PyResult<()> {
        let mut result = Ok(());
        loop {
            py.detach(|| park_timeout(PERIOD));
            let over = is_over();
            if result.is_ok() {
                result = py.check_signals().and_then(|()| self.tell(py));
                self.shared.stops.store(result.is_err(), Ordering::SeqCst);
            }
            if over {
                return result;
            }
        }
    }

    /// Calls Python with all that is new.
    fn tell(&self, py: Python<'_>) -> PyResult<()> {
        for line in std::mem::take(&mut *locked(&self.shared.lines)) {
            self.line.call1(py, (line,))?;
        }
        let latest = locked(&self.shared.progress).take();
        if let (Some(callback), Some(latest)) = (&self.progress, latest) {
            callback.call1(py, latest)?;
        }
        Ok(())
    }
}
