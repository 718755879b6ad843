//! Presets: names for measured points of the trade of speed against accuracy.

use clap::parser::ValueSource;
use clap::{ArgMatches, ValueEnum};

/// A point of the trade of speed against accuracy. `cargo xtask tradeoff` measures each;
/// docs/tradeoff.md has the figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Preset {
    /// A first look
    Fast,
    /// The defaults
    Balanced,
    /// Least error
    Accurate,
}

/// Whether an option is on the command line. Explicit options override a preset.
pub(super) fn is_explicit(matches: &ArgMatches, id: &str) -> bool {
    matches.value_source(id) == Some(ValueSource::CommandLine)
}
