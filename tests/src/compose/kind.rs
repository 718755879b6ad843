//! The kinds of variants.

use clap::ValueEnum;

/// The kind of a variant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// One environment by direction, with detail from 40 degrees to 1 degree
    Panorama,
    /// Another coloured noise picture in each view
    Noise,
    /// Mid-grey, and another exposure of the whole photograph in each view
    GreyExposure,
    /// Another uniform colour in each view
    PerView,
    /// One picture, which stands still in the image: an object turned in front of a fixed camera
    Turntable,
    /// The same with noise, and another exposure of the whole photograph in each view
    TurntableNoise,
    /// No background: the coverage is the alpha channel
    Alpha,
    /// Black
    Black,
}

impl Kind {
    /// The kind's name on the command line.
    pub(super) fn name(self) -> String {
        self.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
    }
}
