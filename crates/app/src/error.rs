//! Exit statuses of errors.

use files::InputError;

pub use crate::messages::Interrupted;

/// Wrong arguments: the message of the command line's parser, in one line.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WrongArguments(pub(crate) String);

/// The exit status of an error: 2 for wrong input ([`InputError`]) and wrong arguments, 130 for
/// [`Interrupted`], 1 for any other error.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if error.is::<InputError>() || error.is::<WrongArguments>() {
        2
    } else if error.downcast_ref::<Interrupted>().is_some() {
        130
    } else {
        1
    }
}
