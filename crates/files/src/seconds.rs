//! The form of durations in TOML files, for serde: a number of seconds.

use std::time::Duration;

use serde::{Deserialize, Deserializer, Serializer};

/// Writes the seconds of a duration.
///
/// # Errors
/// If the format cannot hold a number.
#[allow(clippy::ref_option, reason = "serde requires this signature")]
pub fn serialize<S: Serializer>(time: &Option<Duration>, s: S) -> Result<S::Ok, S::Error> {
    match time {
        Some(time) => s.serialize_f64(time.as_secs_f64()),
        None => s.serialize_none(),
    }
}

/// Reads a duration from its seconds.
///
/// # Errors
/// If they are negative or too many.
pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Duration>, D::Error> {
    let seconds = Option::<f64>::deserialize(d)?;
    seconds.map(Duration::try_from_secs_f64).transpose().map_err(serde::de::Error::custom)
}
