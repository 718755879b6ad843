//! The choice of a model for the exposures of photographs.

use serde::{Deserialize, Serialize};

/// The choice of a model for the exposures of photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureChoice {
    /// One for each photograph, if they differ visibly
    #[default]
    Auto,
    /// The same for all photographs
    None,
    /// One for each photograph and channel
    PerView,
}

/// The model for the exposures of photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureModel {
    /// The same for all photographs.
    Even,
    /// One for each photograph and channel.
    PerView,
}

impl ExposureChoice {
    /// The model, for photographs whose exposures differ visibly or not.
    pub fn resolve(self, differ: bool) -> ExposureModel {
        match self {
            ExposureChoice::PerView => ExposureModel::PerView,
            ExposureChoice::Auto if differ => ExposureModel::PerView,
            ExposureChoice::Auto | ExposureChoice::None => ExposureModel::Even,
        }
    }
}
