#![doc = include_str!("../README.md")]

mod aim;
mod backdrop;
mod background;
mod bounds;
mod carve;
mod cloud;
mod distant;
mod exposure;
mod matches;
#[cfg(test)]
mod matches_tests;
mod overlay;
mod picture;
#[cfg(test)]
mod real_tests;
mod report;
mod still;
#[cfg(test)]
mod surroundings_tests;
#[cfg(test)]
mod test_ball;
#[cfg(test)]
mod tests;
mod text;

pub use aim::radius_clear_of_cameras;
pub use background::BackgroundEstimate;
pub use bounds::{
    SphereSource, Surroundings, check_cameras, check_places, looks_away, surroundings,
};
pub use exposure::{Exposure, ExposureSource, MOST_SPREAD, exposure_spread, exposures_differ};
pub use overlay::overlay;
pub use picture::Picture;
pub use report::{Report, inspect};
pub use still::Still;
