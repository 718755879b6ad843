//! Checks of settings: of a tracer, of a warp, of a whole program.

/// A setting that is out of range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name} is {found}, expected {expected}")]
pub struct InvalidSetting {
    /// The name of the setting.
    pub name: &'static str,
    /// Its value.
    pub found: String,
    /// The values that are allowed.
    pub expected: &'static str,
}

/// A setting with its value, whether the value is valid, and the valid values.
///
/// ```
/// use field::Check;
///
/// let checks = |spp: u32| [Check::samples("spp", spp), Check::weight("eikonal", 0.1)];
/// assert_eq!(Check::all(checks(16)), Ok(()));
/// let error = Check::all(checks(0)).unwrap_err();
/// assert_eq!(error.to_string(), "spp is 0, expected 1 to 65536");
/// ```
#[derive(Clone, Debug)]
pub struct Check {
    holds: bool,
    /// The error if it does not hold.
    invalid: InvalidSetting,
}

/// The whole numbers of files of settings, in words: TOML has 64 bits with a sign.
const WHOLE_NUMBERS: &str = "at most 9223372036854775807";

impl Check {
    /// The check of the setting `name`: its value, whether it is valid, and the valid values.
    pub fn new(
        name: &'static str,
        found: impl ToString,
        holds: bool,
        expected: &'static str,
    ) -> Self {
        Check { holds, invalid: InvalidSetting { name, found: found.to_string(), expected } }
    }

    /// The check of a weight: from 0 to 1,000,000.
    pub fn weight(name: &'static str, value: f64) -> Self {
        Self::new(name, value, (0.0..=1e6).contains(&value), "a number from 0 to 1000000")
    }

    /// The check of a number that must be 1 or more, at most 2^63 − 1: TOML has no larger ones.
    pub fn at_least_one(name: &'static str, value: u64) -> Self {
        let is_large = i64::try_from(value).is_err();
        let expected = if is_large { WHOLE_NUMBERS } else { "1 or more" };
        Self::new(name, value, value >= 1 && !is_large, expected)
    }

    /// The check of a seed: at most 2^63 − 1, since TOML has no larger numbers.
    pub fn seed(name: &'static str, value: u64) -> Self {
        Self::new(name, value, i64::try_from(value).is_ok(), WHOLE_NUMBERS)
    }

    /// The check of a number of samples: from 1 to 65,536.
    pub fn samples(name: &'static str, value: u32) -> Self {
        Self::new(name, value, (1..=65536).contains(&value), "1 to 65536")
    }

    /// The first failure of these checks.
    ///
    /// # Errors
    /// If a check fails.
    pub fn all(checks: impl IntoIterator<Item = Check>) -> Result<(), InvalidSetting> {
        match checks.into_iter().find(|check| !check.holds) {
            Some(check) => Err(check.invalid),
            None => Ok(()),
        }
    }
}
