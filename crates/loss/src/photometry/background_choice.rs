//! The choice of a model for the background.

use inspect::Surroundings;
use serde::{Deserialize, Serialize};

/// The choice of a model for the background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum BackgroundChoice {
    /// A constant where the photographs have one uniform background, one colour for each where
    /// each has a uniform one, a picture where the backdrop stands still in the image, an
    /// environment by direction where everything behind the object is far away, and else a volume
    #[default]
    Auto,
    /// One colour, estimated from the photographs
    Constant,
    /// One colour for each photograph, estimated from it
    PerView,
    /// One picture behind all photographs: right for an object that turns in front of a fixed
    /// camera
    Picture,
    /// An environment by direction: right where everything behind the object is far away
    Direction,
    /// Everything behind the bounding sphere, near and far
    Volume,
}

/// The model for the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackgroundKind {
    /// One colour, which is not trained.
    Constant,
    /// One colour for each photograph, which is not trained.
    PerView,
    /// One picture behind all photographs, estimated from them, which is not trained.
    Picture,
    /// An environment by direction.
    Direction,
    /// Everything behind the bounding sphere.
    Volume,
}

impl BackgroundChoice {
    /// The model for the background of photographs.
    pub fn resolve(self, found: &Surroundings) -> BackgroundKind {
        match self {
            BackgroundChoice::Auto if found.is_common() => BackgroundKind::Constant,
            BackgroundChoice::Auto if found.is_per_view() => BackgroundKind::PerView,
            BackgroundChoice::Auto if found.is_still() => BackgroundKind::Picture,
            BackgroundChoice::Auto if found.is_distant() => BackgroundKind::Direction,
            BackgroundChoice::Constant => BackgroundKind::Constant,
            BackgroundChoice::PerView => BackgroundKind::PerView,
            BackgroundChoice::Picture => BackgroundKind::Picture,
            BackgroundChoice::Direction => BackgroundKind::Direction,
            BackgroundChoice::Auto | BackgroundChoice::Volume => BackgroundKind::Volume,
        }
    }
}

impl BackgroundKind {
    /// Whether the background has trained parameters.
    pub fn is_trained(self) -> bool {
        matches!(self, BackgroundKind::Direction | BackgroundKind::Volume)
    }
}

#[cfg(test)]
mod tests {
    use field::Sphere;
    use glam::DVec3;
    use inspect::{BackgroundEstimate, SphereSource, Still};

    use super::*;

    #[test]
    fn auto_takes_what_the_photographs_show() {
        let of = |confidence: f32, still: f32, distant: f32| {
            let background = BackgroundEstimate { confidence, ..BackgroundEstimate::NOTHING };
            let found = Surroundings {
                sphere: Sphere { center: DVec3::ZERO, radius: 1.0 },
                source: SphereSource::Cameras,
                background,
                backgrounds: vec![background; 3],
                distant,
                still: Still { share: still, ..Still::NONE },
                points: Vec::new(),
            };
            assert_eq!(BackgroundChoice::Volume.resolve(&found), BackgroundKind::Volume);
            BackgroundChoice::Auto.resolve(&found)
        };
        assert_eq!(of(1.0, 0.0, 0.0), BackgroundKind::Constant);
        assert_eq!(of(0.0, 0.95, 0.95), BackgroundKind::Picture);
        assert_eq!(of(0.0, 0.75, 0.95), BackgroundKind::Direction);
        assert_eq!(of(0.0, 0.0, 0.85), BackgroundKind::Volume);
    }
}
