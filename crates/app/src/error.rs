//! Exit statuses of errors.

use files::{InputError, WriteError};

pub use crate::messages::Interrupted;

/// Wrong arguments: the message of the command line's parser, in one line.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WrongArguments(pub(crate) String);

/// The wrong input, if that is the error of a command: on its own, or as a case of the error of a
/// library.
pub fn input_error(error: &anyhow::Error) -> Option<&InputError> {
    error
        .downcast_ref::<InputError>()
        .or_else(|| error.downcast_ref::<WriteError>()?.input())
        .or_else(|| error.downcast_ref::<scene::synth::Error>()?.input())
        .or_else(|| error.downcast_ref::<poses::Error>()?.input())
        .or_else(|| error.downcast_ref::<fit::FitError>()?.input())
        .or_else(|| error.downcast_ref::<report::Error>()?.input())
}

/// The exit status of an error: 2 for wrong input ([`input_error`]) and wrong arguments, 130 for
/// [`Interrupted`], 1 for any other error.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if input_error(error).is_some() || error.is::<WrongArguments>() {
        2
    } else if error.downcast_ref::<Interrupted>().is_some() {
        130
    } else {
        1
    }
}

/// An error and its causes, in one line.
pub fn error_line(error: &anyhow::Error) -> String {
    let chain: Vec<String> = error.chain().map(|e| e.to_string().replace('\n', " ")).collect();
    files::printable(&chain.join(": "))
}
