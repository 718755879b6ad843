//! How a run ends: the exit status of an error.

use io::InputError;

/// A run that Ctrl-C ended; what it had is saved. Exit status 130.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The exit status for an error: 2 for wrong input, 130 after Ctrl-C, 1 for anything else.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if error.downcast_ref::<InputError>().is_some() {
        2
    } else if error.downcast_ref::<Interrupted>().is_some() {
        130
    } else {
        1
    }
}
