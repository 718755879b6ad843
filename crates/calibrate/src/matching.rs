//! The decision between given cameras and those that places of points adjust.

use serde::Serialize;

use crate::{Calibration, Residuals};

/// The median residual of all views must fall by this share of itself, or that of one view that is
/// off. With exact poses it fell from 0.06 to 0.05 pixels, with those of DTU from 0.07 to 0.05, and
/// with poses that are off by 0.4 degrees from 1.36 to 0.05.
const LEAST_FALL: f64 = 0.5;

/// A view is off if its residual is above this multiple of the median of all adjusted views.
const OFF: f64 = 5.0;

/// The result of an adjustment: whether cameras explain the places of points better after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Matching {
    /// The number of places.
    pub places: usize,
    /// The median residual with the given cameras, in pixels.
    pub given_pixels: f64,
    /// The same with the adjusted ones.
    pub adjusted_pixels: f64,
    /// The number of views that are off with the given cameras: five times more than the median of
    /// the adjusted ones.
    pub given_off: usize,
    /// The same with the adjusted ones.
    pub adjusted_off: usize,
    /// The number of views with too few places, which keep their poses.
    pub held: usize,
    /// The median correction of a view, in pixels.
    pub pixels: f64,
    /// Whether the corrections are kept.
    pub is_kept: bool,
}

impl Matching {
    /// The result, from the residuals with the given and with the adjusted cameras. A view without
    /// a place keeps its pose.
    pub fn of(given: &Residuals, adjusted: &Residuals, calibration: &Calibration) -> Self {
        let falls = |given: f64, adjusted: f64| adjusted < (1.0 - LEAST_FALL) * given;
        let is_off = |r: &f64| r.is_finite() && *r > OFF * adjusted.median;
        let mut views = given.of_views.iter().zip(&adjusted.of_views);
        let finds_view = views.clone().any(|(a, b)| is_off(a) && falls(*a, *b));
        let spoils_view = views.any(|(a, b)| is_off(b) && falls(*b, *a));
        Matching {
            places: given.observations,
            given_pixels: given.median,
            adjusted_pixels: adjusted.median,
            given_off: given.of_views.iter().filter(|r| is_off(r)).count(),
            adjusted_off: adjusted.of_views.iter().filter(|r| is_off(r)).count(),
            held: adjusted.of_views.iter().filter(|r| r.is_infinite()).count(),
            pixels: calibration.median_pixels(),
            is_kept: !spoils_view && (falls(given.median, adjusted.median) || finds_view),
        }
    }

    /// The result in one line.
    pub fn text(&self) -> String {
        let Matching { places, given_pixels, adjusted_pixels, pixels, is_kept, .. } = self;
        let Matching { given_off, adjusted_off, held, .. } = self;
        let verdict = if *is_kept { "adjusted" } else { "not adjusted" };
        let mut text = format!(
            "cameras: {verdict} before the fit; {places} places of points are {given_pixels:.2} \
             pixels off in the median, {adjusted_pixels:.2} after an adjustment that moves a view \
             by {pixels:.2} pixels"
        );
        if *given_off + *adjusted_off > 0 {
            let limit = OFF * adjusted_pixels;
            text += &format!(
                "; views that are off by more than {limit:.2}: {given_off} before it, \
                 {adjusted_off} after it"
            );
        }
        if *held > 0 {
            text += &format!("; views with too few places, which keep their poses: {held}");
        }
        text
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
        let residuals = |median| Residuals { observations: 100, median, of_views: vec![median; 2] };
        for (adjusted, is_kept) in [(0.1, true), (0.3, false), (0.5, false), (f64::INFINITY, false)]
        {
            let found = Matching::of(&residuals(0.4), &residuals(adjusted), &calibration);
            assert_eq!(found.is_kept, is_kept, "{adjusted}");
            let words = if is_kept { "cameras: adjusted" } else { "cameras: not adjusted" };
            assert!(found.text().starts_with(words), "{}", found.text());
        }
        // The median hardly falls if one view of many is off.
        let views =
            |of: [f64; 3]| Residuals { observations: 100, median: 0.05, of_views: of.into() };
        for (before, after, is_kept) in [
            ([0.05, 1.3, 0.05], [0.05, 0.06, 0.05], true),
            ([0.05, 1.3, 0.05], [0.05, 0.9, 0.05], false),
            ([0.05, 0.2, 0.05], [0.05, 0.06, 0.05], false),
            ([0.05, 1.3, 0.05], [0.05, 0.06, 0.9], false),
            ([0.05, 1.3, f64::INFINITY], [0.05, 0.06, f64::INFINITY], true),
        ] {
            let found = Matching::of(&views(before), &views(after), &calibration);
            assert_eq!(found.is_kept, is_kept, "{before:?} {after:?}");
        }
    }
}
