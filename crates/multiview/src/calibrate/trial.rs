//! The decision between given and refined cameras.

use serde::Serialize;

use crate::calibrate::Calibration;

/// The result of a trial: whether cameras explain the photographs better after refinement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Trial {
    /// The mean robust residual of a pixel with the given cameras.
    pub given: f64,
    /// The same with the refined ones.
    pub refined: f64,
    /// The standard error of the difference, over the views.
    pub noise: f64,
    /// The median correction of a view, in pixels.
    pub pixels: f64,
    /// Whether the corrections are kept.
    pub is_kept: bool,
}

/// The residual must fall by this many standard errors.
const ERRORS: f64 = 3.0;

/// The residual must fall by this share of itself. With exact poses it fell by up to 3.1 % of a
/// small noise; with poses that are off by 0.4° it falls by 11 to 17 %.
const LEAST_FALL: f64 = 0.05;

/// The fall of the residual from which on corrections are kept.
fn least_fall(given: f64, noise: f64) -> f64 {
    (ERRORS * noise).max(LEAST_FALL * given)
}

impl Trial {
    /// The result, from the mean residuals of each view with the given and with the refined
    /// cameras. Both have one element or more, and as many.
    pub fn of(given: &[f64], refined: &[f64], calibration: &Calibration) -> Self {
        let n = given.len() as f64;
        let falls: Vec<f64> = given.iter().zip(refined).map(|(a, b)| a - b).collect();
        let [given, refined] = [given, refined].map(|all| all.iter().sum::<f64>() / n);
        let fall = given - refined;
        let variance = falls.iter().map(|f| (f - fall) * (f - fall)).sum::<f64>() / n;
        let noise = (variance / (n - 1.0).max(1.0)).sqrt();
        let is_kept = fall > least_fall(given, noise);
        Trial { given, refined, noise, pixels: calibration.median_pixels(), is_kept }
    }

    /// The result in one line.
    pub fn text(&self) -> String {
        let fall = 100.0 * (1.0 - self.refined / self.given);
        let noise = 100.0 * self.noise / self.given;
        let needed = 100.0 * least_fall(self.given, self.noise) / self.given;
        let verdict = if self.is_kept { "refined from here on" } else { "kept as given" };
        format!(
            "cameras: {verdict}; a trial lowers the residual by {fall:.1} % ({needed:.1} % needed: \
             its noise is {noise:.1} %) and moves a view by {:.2} pixels",
            self.pixels
        )
    }
}

#[cfg(test)]
mod tests {
    use field::Sphere;
    use glam::DVec3;

    use super::*;
    use crate::calibrate::Freedom;

    #[test]
    fn cameras_are_kept_if_the_residual_falls_by_more_than_its_noise() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let (focal, middle) = (glam::DVec2::splat(50.0), glam::DVec2::splat(16.0));
        let eye = DVec3::new(0.0, 0.0, 4.0);
        let camera =
            render::Camera::look_at(32, 32, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let calibration = Calibration::new(vec![camera; 3], sphere, Freedom::POSES);
        let given = [1.0, 1.1, 0.9];
        for (refined, is_kept) in [
            // All views fall by 0.1, by 0.01, and by 0.1 ± 0.06.
            ([0.9, 1.0, 0.8], true),
            ([0.99, 1.09, 0.89], false),
            ([0.9, 0.92, 0.88], false),
            ([1.1, 1.2, 1.0], false),
        ] {
            let trial = Trial::of(&given, &refined, &calibration);
            assert_eq!(trial.is_kept, is_kept, "{trial:?}");
            let words = if is_kept { "refined from here on" } else { "kept as given" };
            assert!(trial.text().contains(words));
            assert!(refined[0] != 0.99 || trial.text().contains("by 1.0 % (5.0 % needed"));
        }
        // Falls of 0.1, 0.18 and 0.02: the standard deviation is 0.08, that of the mean 0.08/√3.
        let noise = Trial::of(&given, &[0.9, 0.92, 0.88], &calibration).noise;
        assert!((noise - 0.08 / 3f64.sqrt()).abs() < 1e-12, "{noise}");
    }
}
