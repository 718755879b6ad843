//! Durations as text.

use std::time::Duration;

/// Parses a duration such as 90s, 10m or 1h30m.
///
/// # Errors
/// If the text is no duration, or the duration is 0. The error describes the expected text.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let duration = humantime::parse_duration(text).map_err(|e| e.to_string())?;
    if duration.is_zero() { Err("a time above 0".to_owned()) } else { Ok(duration) }
}
