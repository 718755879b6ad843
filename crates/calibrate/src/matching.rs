//! The decision between given cameras and those that places of points adjust.

use serde::Serialize;

use crate::{Calibration, Residuals};

/// The median residual must fall by this share of itself. With exact poses it fell from 0.06 to
/// 0.05 pixels, with those of DTU from 0.07 to 0.05, and with poses that are off by 0.4 degrees
/// from 1.36 to 0.05.
const LEAST_FALL: f64 = 0.5;

/// The result of an adjustment: whether cameras explain the places of points better after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Matching {
    /// The number of places.
    pub places: usize,
    /// The median residual with the given cameras, in pixels.
    pub given_pixels: f64,
    /// The same with the adjusted ones.
    pub adjusted_pixels: f64,
    /// The median correction of a view, in pixels.
    pub pixels: f64,
    /// Whether the corrections are kept.
    pub is_kept: bool,
}

impl Matching {
    /// The result, from the residuals with the given and with the adjusted cameras.
    pub fn of(given: Residuals, adjusted: Residuals, calibration: &Calibration) -> Self {
        Matching {
            places: given.observations,
            given_pixels: given.median,
            adjusted_pixels: adjusted.median,
            pixels: calibration.median_pixels(),
            is_kept: adjusted.median < (1.0 - LEAST_FALL) * given.median,
        }
    }

    /// The result in one line.
    pub fn text(&self) -> String {
        let Matching { places, given_pixels, adjusted_pixels, pixels, is_kept } = self;
        let verdict = if *is_kept { "adjusted" } else { "kept as given" };
        format!(
            "cameras: {verdict}; {places} places of points are {given_pixels:.2} pixels off in the \
             median, {adjusted_pixels:.2} after an adjustment that moves a view by {pixels:.2} \
             pixels"
        )
    }
}

#[cfg(test)]
mod tests {
    use field::Sphere;
    use glam::{DVec2, DVec3};
    use render::Camera;

    use super::*;
    use crate::Freedom;

    #[test]
    fn adjusted_cameras_are_kept_if_the_residual_falls_by_half() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let (focal, middle) = (DVec2::splat(50.0), DVec2::splat(16.0));
        let eye = DVec3::new(0.0, 0.0, 4.0);
        let camera = Camera::look_at(32, 32, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let calibration = Calibration::new(vec![camera], sphere, Freedom::POSES);
        let residuals = |median| Residuals { observations: 100, median };
        for (adjusted, is_kept) in [(0.1, true), (0.3, false), (0.5, false), (f64::INFINITY, false)]
        {
            let found = Matching::of(residuals(0.4), residuals(adjusted), &calibration);
            assert_eq!(found.is_kept, is_kept, "{adjusted}");
            let words = if is_kept { "cameras: adjusted" } else { "cameras: kept as given" };
            assert!(found.text().starts_with(words), "{}", found.text());
        }
    }
}
