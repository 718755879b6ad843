//! Levels of a grid as text.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The number of coefficients along a side of the levels of a grid, coarse to fine: as text, for
/// example `32,64,128`, or `none`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct GridLevels(pub Vec<usize>);

impl GridLevels {
    /// Whether the levels are valid; see [`Self::EXPECTED`].
    pub fn is_valid(&self) -> bool {
        self.0.len() <= 4
            && self.0.iter().all(|side| (4..=256).contains(side))
            && self.0.is_sorted_by(|a, b| a < b)
    }

    /// Valid levels, in words.
    pub const EXPECTED: &'static str =
        "up to 4 rising numbers from 4 to 256, for example 32,64,128, or none";
}

impl From<GridLevels> for String {
    fn from(levels: GridLevels) -> String {
        levels.to_string()
    }
}

impl TryFrom<String> for GridLevels {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse().map_err(|_| format!("{text:?}, which is not {}", Self::EXPECTED))
    }
}

impl fmt::Display for GridLevels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let levels: Vec<String> = self.0.iter().map(usize::to_string).collect();
        f.write_str(if levels.is_empty() { "none" } else { "" })?;
        f.write_str(&levels.join(","))
    }
}

impl FromStr for GridLevels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = || text.split(',').map(|n| n.trim().parse().ok()).collect();
        let levels = if text == "none" { Some(Vec::new()) } else { numbers() };
        let levels = levels.map(GridLevels).filter(GridLevels::is_valid);
        levels.ok_or_else(|| format!("expected {}", Self::EXPECTED))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_as_they_are_written() {
        for levels in [vec![], vec![32], vec![16, 64, 256]] {
            let levels = GridLevels(levels);
            assert_eq!(levels.to_string().parse(), Ok(levels));
        }
        for wrong in ["", "64,32", "3", "32,,64", "257", "8,16,32,64,128", "a", "-1"] {
            let expected = GridLevels::EXPECTED;
            assert_eq!(wrong.parse::<GridLevels>(), Err(format!("expected {expected}")));
            // Messages about files put "found" before it.
            let found = format!("{wrong:?}, which is not {expected}");
            assert_eq!(GridLevels::try_from(wrong.to_owned()), Err(found));
        }
    }
}
