//! Checks of the entries of an input.

use std::path::Path;

use crate::InputError;

/// One entry with its value, whether the value is valid, and the valid values.
pub struct Check {
    name: &'static str,
    found: String,
    holds: bool,
    expected: &'static str,
}

impl Check {
    /// The check of the entry `name`, whose value `holds` or not, for what it found and expected.
    pub fn new(
        name: &'static str,
        found: impl ToString,
        holds: bool,
        expected: &'static str,
    ) -> Self {
        Check { name, found: found.to_string(), holds, expected }
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
