//! Durations as text.

use std::time::Duration;

/// Parses a duration such as 90s, 10m or 1h30m. A number alone stands for seconds.
///
/// # Errors
/// If the text is no duration, or the duration is 0. The error describes the expected text.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    let duration = match seconds {
        Some(duration) => duration,
        None => humantime::parse_duration(text).unwrap_or_default(),
    };
    let expected = "expected a time above 0, such as 90s, 10m or 1h30m";
    if duration.is_zero() { Err(expected.to_owned()) } else { Ok(duration) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_alone_stands_for_seconds() {
        assert_eq!(parse_duration("60"), Ok(Duration::from_secs(60)));
        assert_eq!(parse_duration("1.5"), parse_duration("1500ms"));
        assert_eq!(parse_duration("1h30m"), Ok(Duration::from_secs(5400)));
        for text in ["", "0", "-1", "nan", "inf", "1e300", "0s", "ten"] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }
}
