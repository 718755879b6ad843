//! Ctrl-C: a fit ends with a checkpoint, every other command at once; both with status 130.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The error of a command that was stopped: of a fit or a search for poses by Ctrl-C, whose state
/// is saved, or of any command by its host. The exit status is 130.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The state that the handler of Ctrl-C shares with the commands.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<Flags>);

#[derive(Debug, Default)]
struct Flags {
    /// A fit is iterating: it will see the request and stop.
    iterating: AtomicBool,
    /// Ctrl-C was pressed meanwhile.
    requested: AtomicBool,
    /// The folders in which this process writes files.
    folders: Mutex<Vec<PathBuf>>,
}

impl Flags {
    /// Ends the program; a file that is being written stays as it was.
    fn exit(&self) -> ! {
        let folders = self.folders.lock().unwrap_or_else(PoisonError::into_inner);
        folders.iter().for_each(|folder| files::remove_own_temporary_files(folder));
        std::process::exit(130)
    }
}

impl Interrupt {
    /// Handles Ctrl-C from now on.
    ///
    /// # Errors
    /// If the system refuses the handler.
    pub(crate) fn install(&self) -> Result<(), ctrlc::Error> {
        let flags = Arc::clone(&self.0);
        ctrlc::set_handler(move || {
            let waits = flags.iterating.load(Ordering::SeqCst);
            if !waits || flags.requested.swap(true, Ordering::SeqCst) {
                flags.exit();
            }
        })
    }

    /// Removes the temporary files of this process in `folder` if Ctrl-C ends the program.
    pub(crate) fn clean(&self, folder: &Path) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let mut folders = self.0.folders.lock().unwrap_or_else(PoisonError::into_inner);
        folders.push(folder.to_owned());
    }

    /// Runs the iterations of a fit. The first Ctrl-C during `iterate` is a request, which
    /// [`requested`](Self::requested) reports; the second one ends the program.
    pub(crate) fn while_iterating<T>(&self, iterate: impl FnOnce() -> T) -> T {
        self.0.iterating.store(true, Ordering::SeqCst);
        let result = iterate();
        self.0.iterating.store(false, Ordering::SeqCst);
        result
    }

    /// Does what the first Ctrl-C does, if a fit is iterating. Returns whether one is.
    pub(crate) fn request(&self) -> bool {
        let iterating = self.is_iterating();
        self.0.requested.fetch_or(iterating, Ordering::SeqCst);
        iterating
    }

    /// Whether a fit is iterating.
    pub(crate) fn is_iterating(&self) -> bool {
        self.0.iterating.load(Ordering::SeqCst)
    }

    /// Whether Ctrl-C was pressed while a fit was iterating.
    pub(crate) fn requested(&self) -> bool {
        self.0.requested.load(Ordering::SeqCst)
    }
}
