//! Arguments that several commands have, and the error of a wrong one.

use std::time::Duration;

/// A wrong argument of a command.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WrongArgument(pub(crate) String);

/// Parses a number of minutes.
pub(crate) fn minutes(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().map(|minutes| 60.0 * minutes);
    let time = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.ok_or_else(|| "expected a number of minutes, 0 or more".to_owned())
}
