//! Checks of the entries of an input.

use std::path::Path;

use crate::InputError;

/// The whole numbers of TOML, in words.
const TOML_NUMBERS: &str = "at most 9223372036854775807";

/// One entry with its value, whether the value is valid, and the valid values.
#[derive(Debug)]
pub struct Check {
    name: &'static str,
    found: String,
    holds: bool,
    expected: &'static str,
}

impl Check {
    /// The check of the entry `name`: its value, whether it is valid, and the valid values.
    pub fn new(
        name: &'static str,
        found: impl ToString,
        holds: bool,
        expected: &'static str,
    ) -> Self {
        Check { name, found: found.to_string(), holds, expected }
    }

    /// The check of a weight: from 0 to 1,000,000.
    pub fn weight(name: &'static str, value: f64) -> Self {
        Self::new(name, value, (0.0..=1e6).contains(&value), "a number from 0 to 1000000")
    }

    /// The check of a number that must be 1 or more, at most 2^63 − 1: TOML has no larger ones.
    pub fn at_least_one(name: &'static str, value: u64) -> Self {
        let is_large = i64::try_from(value).is_err();
        let expected = if is_large { TOML_NUMBERS } else { "1 or more" };
        Self::new(name, value, value >= 1 && !is_large, expected)
    }

    /// The check of a seed: at most 2^63 − 1, since TOML has no larger numbers.
    pub fn seed(name: &'static str, value: u64) -> Self {
        Self::new(name, value, i64::try_from(value).is_ok(), TOML_NUMBERS)
    }

    /// The check of a number of samples: from 1 to 65,536.
    pub fn samples(name: &'static str, value: u32) -> Self {
        Self::new(name, value, (1..=65536).contains(&value), "1 to 65536")
    }

    /// The first failure of these checks. `source` is the origin of the values.
    ///
    /// # Errors
    /// If a check fails.
    pub fn all(source: &Path, checks: Vec<Check>) -> Result<(), InputError> {
        match checks.into_iter().find(|check| !check.holds) {
            Some(Check { name, found, expected, .. }) => {
                Err(InputError::new(source, name, found, expected))
            }
            None => Ok(()),
        }
    }
}
