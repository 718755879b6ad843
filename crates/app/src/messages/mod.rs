//! The output, the progress and the interruption of a command.

mod clock;
mod host;
mod interrupt;
mod progress;

use std::io::Write;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::{Arc, OnceLock};

pub use host::Host;
pub use interrupt::Interrupted;
pub use progress::Progress;

use clock::Clock;
use interrupt::Interrupt;

use crate::serve::{Address, Known, News, Site, State};

/// The receiver of the results, lines and progress of one command, and its requests to stop.
#[derive(Clone, Default)]
pub struct Console {
    /// The time of the next line of progress.
    clock: Clock,
    /// The requests of Ctrl-C.
    interrupt: Interrupt,
    /// The program around the command; `None` for the standard streams.
    host: Option<Arc<dyn Host>>,
    /// The page of the command, if it has one.
    site: Arc<OnceLock<Site>>,
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

    /// Starts the server of a page, if the command has none yet, and says where it is. `before` is
    /// where a former one was.
    ///
    /// # Errors
    /// If nothing can listen at the address.
    pub(crate) fn serve(
        &self,
        address: Address,
        before: Option<Known>,
        page: impl FnOnce() -> String,
    ) -> anyhow::Result<()> {
        if self.site.get().is_some() {
            return Ok(());
        }
        let interrupt = self.interrupt.clone();
        let site = Site::start(address, before, page(), Box::new(move || interrupt.request()))?;
        self.line(&format!("page: {}", site.url()));
        // One thread starts servers, so there is no other one yet.
        let _ = self.site.set(site);
        Ok(())
    }

    /// The page of the command, if it has one.
    pub(crate) fn site(&self) -> Option<&Site> {
        self.site.get()
    }

    /// Tells the page about the end of the command, and waits until it is shown.
    pub(crate) fn close_site(&self, result: &anyhow::Result<()>) {
        let Some(site) = self.site() else { return };
        match result {
            Ok(()) => site.close(State::Ended, "done"),
            Err(error) if error.is::<Interrupted>() => {
                site.close(State::Stopped, "stopped; --resume, or the same command, continues");
            }
            Err(error) => site.close(State::Failed, &crate::error::error_line(error)),
        }
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

    /// Tells the page about the progress.
    fn tell_page(
        &self,
        step: &str,
        fraction: f64,
        text: &dyn Fn() -> String,
        times: &dyn Fn() -> String,
    ) {
        let Some(site) = self.site() else { return };
        site.tell(|| News { step: step.to_owned(), fraction, times: times(), text: text() });
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
