//! The output, the progress and the interruption of a command.

mod clock;
mod host;
mod interrupt;
mod progress;

use std::io::Write;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::Arc;

pub use host::Host;
pub use interrupt::Interrupted;
pub use progress::Progress;

use clock::Clock;
use interrupt::Interrupt;

/// The receiver of the results, lines and progress of one command, and its requests to stop.
#[derive(Clone, Default)]
pub struct Console {
    /// The time of the next line of progress.
    clock: Clock,
    /// The requests of Ctrl-C.
    interrupt: Interrupt,
    /// The program around the command; `None` for the standard streams.
    host: Option<Arc<dyn Host>>,
}

impl std::fmt::Debug for Console {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("hosted", &self.is_hosted()).finish_non_exhaustive()
    }
}

impl Console {
    /// The console of a command that runs in a host.
    pub fn of_host(host: Arc<dyn Host>) -> Self {
        Console { host: Some(host), ..Console::default() }
    }

    /// Whether the command runs in a host.
    pub fn is_hosted(&self) -> bool {
        self.host.is_some()
    }

    /// Handles Ctrl-C from now on; in a host, nothing.
    ///
    /// # Errors
    /// If the system refuses the handler.
    pub fn handle_interrupts(&self) -> Result<(), ctrlc::Error> {
        if self.is_hosted() { Ok(()) } else { self.interrupt.install() }
    }

    /// Removes the temporary files of this process in `folder` if Ctrl-C ends the program.
    pub fn clean(&self, folder: &Path) {
        self.interrupt.clean(folder);
    }

    /// Runs the iterations of a fit. The first Ctrl-C during `iterate` is a request, which
    /// [`stop_requested`](Self::stop_requested) reports; the second one ends the program.
    pub fn while_iterating<T>(&self, iterate: impl FnOnce() -> T) -> T {
        self.interrupt.while_iterating(iterate)
    }

    /// Whether a fit shall stop.
    pub fn stop_requested(&self) -> bool {
        self.interrupt.requested() || self.host.as_ref().is_some_and(|host| host.is_interrupted())
    }

    /// Gives a warning or a note of one line.
    pub fn line(&self, line: &str) {
        match &self.host {
            Some(host) => host.line(&files::printable(line)),
            None => eprintln!("{}", files::printable(line)),
        }
    }

    /// Gives the result. A reader that closed the pipe, for example `head`, is no error.
    ///
    /// # Errors
    /// If standard output cannot be written.
    pub fn result(&self, text: &str) -> std::io::Result<()> {
        if let Some(host) = &self.host {
            host.result(text);
            return Ok(());
        }
        match writeln!(std::io::stdout(), "{text}") {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error),
            _ => Ok(()),
        }
    }

    /// Tells the host about the progress. Unwinds if the host stops a command that is no fit.
    fn tell_host(&self, step: &str, fraction: f64, text: &dyn Fn() -> String) {
        let Some(host) = &self.host else { return };
        host.progress(step, fraction, text);
        if host.is_interrupted() && !self.interrupt.is_iterating() {
            resume_unwind(Box::new(Interrupted));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[derive(Default)]
    struct Notes {
        told: Mutex<Vec<String>>,
        stops: AtomicBool,
    }

    impl Host for Notes {
        fn result(&self, text: &str) {
            self.told.lock().unwrap().push(format!("result {text}"));
        }
        fn line(&self, line: &str) {
            self.told.lock().unwrap().push(format!("line {line}"));
        }
        fn progress(&self, step: &str, fraction: f64, text: &dyn Fn() -> String) {
            self.told.lock().unwrap().push(format!("{step} {fraction} {}", text()));
        }
        fn is_interrupted(&self) -> bool {
            self.stops.load(Ordering::SeqCst)
        }
    }

    #[test]
    fn a_host_gets_results_lines_and_progress() {
        let host = Arc::new(Notes::default());
        let console = Console::of_host(host.clone());
        console.result("{}").unwrap();
        console.line("a\u{1b}b");
        console.progress("step", "{msg}", false).show(0.25, &|| "text".to_owned());
        console.progress("other", "{msg}", true).mover()(2.0);
        let told = host.told.lock().unwrap();
        assert_eq!(*told, ["result {}", "line a\\u{1b}b", "step 0.25 text", "other 1 "]);
    }

    #[test]
    fn a_host_stops_a_fit_by_request_and_any_other_command_by_unwinding() {
        let host = Arc::new(Notes::default());
        let console = Console::of_host(host.clone());
        let progress = console.progress("step", "{msg}", false);
        progress.mover()(0.1);
        host.stops.store(true, Ordering::SeqCst);
        console.while_iterating(|| {
            progress.mover()(0.2);
            assert!(console.stop_requested());
        });
        let stopped = catch_unwind(AssertUnwindSafe(|| progress.mover()(0.3)));
        assert!(stopped.unwrap_err().is::<Interrupted>());
    }
}
