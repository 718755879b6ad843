//! Exit statuses of errors.

use io::InputError;

/// The error of a command that Ctrl-C stopped and that can continue: a fit, or a search for poses.
/// Its state is saved; the exit status is 130.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The exit status of an error: 2 for wrong input ([`InputError`]), 130 for [`Interrupted`], 1 for
/// any other error.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if error.downcast_ref::<InputError>().is_some() {
        2
    } else if error.downcast_ref::<Interrupted>().is_some() {
        130
    } else {
        1
    }
}
