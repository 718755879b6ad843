//! Presets: measured combinations of options that trade speed against accuracy.

use clap::parser::ValueSource;
use clap::{ArgMatches, ValueEnum};

/// A speed/accuracy preset of `gradient` and `fit`.
///
/// `cargo xtask record tradeoff` measures the error and the time of each; docs/tradeoff.md has the
/// results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Preset {
    /// Derivative images: 16 samples per pixel; fits: 2000 iterations
    Fast,
    /// The defaults of all options
    Balanced,
    /// Derivative images: 1024 samples per pixel; fits: 20000 iterations, layers of width 96
    Accurate,
}

impl Preset {
    /// Samples per pixel of a derivative image; `None` for the default.
    pub(super) fn spp(self) -> Option<u32> {
        match self {
            Preset::Fast => Some(16),
            Preset::Balanced => None,
            Preset::Accurate => Some(1024),
        }
    }

    /// Iterations of a fit; `None` for the default.
    pub(super) fn iterations(self) -> Option<u64> {
        match self {
            Preset::Fast => Some(2000),
            Preset::Balanced => None,
            Preset::Accurate => Some(20_000),
        }
    }

    /// Width of the hidden layers of a fit's network; `None` for the default.
    pub(super) fn width(self) -> Option<usize> {
        match self {
            Preset::Fast | Preset::Balanced => None,
            Preset::Accurate => Some(96),
        }
    }
}

/// Returns whether an option is on the command line. Explicit options override a preset.
pub(super) fn is_explicit(matches: &ArgMatches, id: &str) -> bool {
    matches.value_source(id) == Some(ValueSource::CommandLine)
}
