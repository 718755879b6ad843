//! The decision between given cameras and cameras that are adjusted to keypoint matches.

use serde::Serialize;

use crate::calibrate::{Calibration, Residuals};

/// The median residual must fall by this share of itself. With exact poses it fell from 0.06 to
/// 0.05 pixels, with those of DTU from 0.07 to 0.05, and with poses that are off by 0.4 degrees
/// from 1.36 to 0.05.
const LEAST_FALL: f64 = 0.5;

/// A view is off if its residual is above this multiple of the median of all adjusted views.
const OFF: f64 = 5.0;

/// Whether a residual falls enough.
fn falls(given: f64, adjusted: f64) -> bool {
    adjusted < (1.0 - LEAST_FALL) * given
}

/// Whether a view is off. A view without a place is not.
fn is_off(residual: f64, adjusted: &Residuals) -> bool {
    residual.is_finite() && residual > OFF * adjusted.median
}

/// The views that are off with the given cameras, and whose residuals fall by half: a flag for each
/// view. If all residuals do not fall, these views are to be adjusted alone.
pub fn off_views(given: &Residuals, adjusted: &Residuals) -> Vec<bool> {
    let views = given.of_views.iter().zip(&adjusted.of_views);
    views.map(|(a, b)| is_off(*a, adjusted) && falls(*a, *b)).collect()
}

/// The result of an adjustment: whether cameras explain the keypoint matches better after it.
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
    /// The number of views with too few matches, which keep their poses.
    pub held: usize,
    /// The median correction of a view, in pixels.
    pub pixels: f64,
    /// Whether the corrections are kept.
    pub is_kept: bool,
}

impl Matching {
    /// The result of an adjustment of all views, from the residuals with the given and with the
    /// adjusted cameras. They are kept if the median falls by half. A view without a place keeps
    /// its pose.
    pub fn of(given: &Residuals, adjusted: &Residuals, calibration: &Calibration) -> Self {
        let lost = |(a, b): &(&f64, &f64)| a.is_finite() && b.is_infinite();
        let views = given.of_views.iter().zip(&adjusted.of_views);
        let off = |residuals: &Residuals| {
            residuals.of_views.iter().filter(|r| is_off(**r, adjusted)).count()
        };
        Matching {
            places: given.observations,
            given_pixels: given.median,
            adjusted_pixels: adjusted.median,
            given_off: off(given),
            adjusted_off: off(adjusted) + views.filter(lost).count(),
            held: given.of_views.iter().filter(|r| r.is_infinite()).count(),
            pixels: calibration.median_pixels(),
            is_kept: falls(given.median, adjusted.median),
        }
    }

    /// The same of an adjustment of the flagged views alone, which is kept if the residual of each
    /// falls by half.
    pub fn of_views(
        given: &Residuals,
        adjusted: &Residuals,
        calibration: &Calibration,
        is_free: &[bool],
    ) -> Self {
        let views = given.of_views.iter().zip(&adjusted.of_views).zip(is_free);
        let mut free = views.filter(|(_, is_free)| **is_free);
        let is_kept = free.all(|((a, b), _)| falls(*a, *b));
        Matching { is_kept, ..Matching::of(given, adjusted, calibration) }
    }

    /// The result in one line.
    pub fn text(&self) -> String {
        let Matching { places, given_pixels, adjusted_pixels, pixels, is_kept, .. } = self;
        let Matching { given_off, adjusted_off, held, .. } = self;
        let verdict = if *is_kept { "adjusted" } else { "not adjusted" };
        let mut text = format!(
            "cameras: {verdict} before the fit; {places} keypoint matches are {given_pixels:.2} \
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
            text += &format!("; views with too few matches, which keep their poses: {held}");
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
    use crate::calibrate::Freedom;

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
    }

    #[test]
    fn views_that_are_off_are_told_from_noise() {
        let views = |of: [f64; 3]| Residuals { observations: 9, median: 0.05, of_views: of.into() };
        let nowhere = f64::INFINITY;
        for (before, after, off) in [
            ([0.05, 1.3, 0.05], [0.05, 0.06, 0.05], [false, true, false]),
            ([0.05, 1.3, 0.05], [0.05, 0.9, 0.05], [false; 3]),
            ([0.05, 0.2, 0.05], [0.05, 0.06, 0.05], [false; 3]),
            ([0.05, nowhere, 0.05], [0.05, nowhere, 0.05], [false; 3]),
        ] {
            assert_eq!(off_views(&views(before), &views(after)), off, "{before:?} {after:?}");
        }
    }
}
