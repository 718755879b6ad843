//! The budget of a fit: its time, or its iterations.

use std::time::Duration;

use crate::options::{DEFAULT_ITERATIONS, FitOptions};

/// The end of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// The wall time of all its iterations.
    Time(Duration),
    /// Their number.
    Iterations(u64),
}

impl Budget {
    /// The share of the budget that is spent after these iterations, which took `seconds`. At 1 and
    /// above, the fit is finished.
    pub fn progress(self, iterations: u64, seconds: f64) -> f64 {
        match self {
            Budget::Time(time) => seconds / time.as_secs_f64(),
            Budget::Iterations(all) => iterations as f64 / all as f64,
        }
    }
}

impl FitOptions {
    /// The budget of these options. A time goes before a number of iterations.
    pub fn budget(&self) -> Budget {
        let iterations = Budget::Iterations(self.iterations.unwrap_or(DEFAULT_ITERATIONS));
        self.time.map_or(iterations, Budget::Time)
    }
}
