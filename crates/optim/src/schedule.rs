//! The learning rate over the progress of a run.

use serde::{Deserialize, Serialize};

/// The learning rate as a fraction of its peak, over the progress of a run from 0 to 1.
///
/// A schedule depends on progress, not on steps: a run that is bounded by time follows the same
/// course as one that is bounded by steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Schedule {
    /// 1 throughout.
    #[default]
    Constant,
    /// A linear rise from 0 to 1, then half a period of a cosine down to `last` (Loshchilov and
    /// Hutter, "SGDR: Stochastic Gradient Descent with Warm Restarts", ICLR 2017, without
    /// restarts).
    WarmUpCosine {
        /// The progress at which the rise ends and the cosine begins, in [0, 1).
        warm_up: f64,
        /// The fraction left at the end, in [0, 1].
        last: f64,
    },
    /// last^progress: equal parts of the run have equal factors.
    Exponential {
        /// The fraction left at the end, in (0, 1].
        last: f64,
    },
}

/// A setting of a schedule that is out of range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {found}, expected a number {expected}")]
pub struct InvalidSchedule {
    /// The name of the setting.
    pub name: &'static str,
    /// Its value.
    pub found: f64,
    /// The values that are allowed.
    pub expected: &'static str,
}

impl Schedule {
    /// The learning rate as a fraction of its peak. Progress is clamped to [0, 1]. A NaN gives a
    /// NaN, which [`Adam::step`](crate::Adam::step) refuses as a rate.
    pub fn fraction(&self, progress: f64) -> f64 {
        let progress = progress.clamp(0.0, 1.0);
        match *self {
            Schedule::Constant if progress.is_nan() => progress,
            Schedule::Constant => 1.0,
            Schedule::WarmUpCosine { warm_up, .. } if progress < warm_up => progress / warm_up,
            Schedule::WarmUpCosine { warm_up, last } => {
                let fall = (progress - warm_up) / (1.0 - warm_up);
                last + (1.0 - last) * 0.5 * (1.0 + (std::f64::consts::PI * fall).cos())
            }
            Schedule::Exponential { last } => last.powf(progress),
        }
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// Names the first setting that is not.
    pub fn validate(&self) -> Result<(), InvalidSchedule> {
        let check = |name, found: f64, holds: bool, expected| {
            if holds { Ok(()) } else { Err(InvalidSchedule { name, found, expected }) }
        };
        match *self {
            Schedule::Constant => Ok(()),
            Schedule::WarmUpCosine { warm_up, last } => {
                check("warm_up", warm_up, (0.0..1.0).contains(&warm_up), "from 0 to below 1")?;
                check("last", last, (0.0..=1.0).contains(&last), "from 0 to 1")
            }
            Schedule::Exponential { last } => {
                check("last", last, last > 0.0 && last <= 1.0, "above 0, up to 1")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    #[test]
    fn fractions_at_ends_and_middles_match_the_formulas() {
        let cosine = Schedule::WarmUpCosine { warm_up: 0.2, last: 0.1 };
        for (progress, expected) in
            [(-1.0, 0.0), (0.0, 0.0), (0.1, 0.5), (0.2, 1.0), (0.6, 0.55), (1.0, 0.1), (7.0, 0.1)]
        {
            assert_relative_eq!(cosine.fraction(progress), expected, epsilon = 1e-12);
        }
        let exponential = Schedule::Exponential { last: 0.01 };
        for (progress, expected) in [(0.0, 1.0), (0.5, 0.1), (1.0, 0.01), (f64::INFINITY, 0.01)] {
            assert_relative_eq!(exponential.fraction(progress), expected, epsilon = 1e-12);
        }
        assert_eq!(Schedule::default().fraction(0.3), 1.0);
        assert_eq!(Schedule::WarmUpCosine { warm_up: 0.0, last: 0.0 }.fraction(0.0), 1.0);
    }

    #[test]
    fn a_progress_of_nan_gives_a_fraction_of_nan() {
        let all = [
            Schedule::Constant,
            Schedule::WarmUpCosine { warm_up: 0.1, last: 0.0 },
            Schedule::Exponential { last: 0.1 },
        ];
        assert!(all.iter().all(|s| s.fraction(f64::NAN).is_nan()));
    }

    proptest! {
        #[test]
        fn fractions_fall_continuously_from_the_peak(
            warm_up in 0.0..0.9f64,
            last in 0.001..1.0f64,
            p in 0.0..1.0f64,
        ) {
            let cosine = Schedule::WarmUpCosine { warm_up, last };
            for schedule in [cosine, Schedule::Exponential { last }] {
                prop_assert_eq!(schedule.validate(), Ok(()));
                let (here, next) = (schedule.fraction(p), schedule.fraction(p + 1e-9));
                prop_assert!((0.0..=1.0 + 1e-12).contains(&here));
                prop_assert!((here - next).abs() < 1e-6 || p < warm_up);
                prop_assert!(next <= here + 1e-12 || p < warm_up);
            }
        }
    }

    #[test]
    fn validate_names_a_setting_out_of_range() {
        for warm_up in [-0.1, 1.0, f64::NAN] {
            let error = Schedule::WarmUpCosine { warm_up, last: 0.1 }.validate().unwrap_err();
            assert_eq!(error.name, "warm_up");
        }
        for last in [-0.1, 1.1, f64::NAN] {
            assert_eq!(
                Schedule::WarmUpCosine { warm_up: 0.1, last }.validate().unwrap_err().name,
                "last"
            );
            assert_eq!(Schedule::Exponential { last }.validate().unwrap_err().name, "last");
        }
        let error = Schedule::Exponential { last: 0.0 }.validate().unwrap_err();
        assert_eq!(error.to_string(), "last is 0, expected a number above 0, up to 1");
    }

    #[test]
    fn a_schedule_survives_toml_and_unknown_keys_are_refused() {
        let schedule = Schedule::WarmUpCosine { warm_up: 0.05, last: 0.03 };
        let text = toml::to_string(&schedule).unwrap();
        assert_eq!(text, "kind = \"warm_up_cosine\"\nwarm_up = 0.05\nlast = 0.03\n");
        assert_eq!(toml::from_str::<Schedule>(&text).unwrap(), schedule);
        assert_eq!(toml::from_str::<Schedule>("kind = \"constant\"").unwrap(), Schedule::Constant);
        assert!(toml::from_str::<Schedule>("kind = \"exponential\"\nlast = 0.1\nend = 1").is_err());
    }
}
