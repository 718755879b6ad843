//! The clock of a fit.

use crate::budget::Budget;

/// The clock of a fit, over all sessions of its run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clock {
    /// The number of finished iterations.
    pub iteration: u64,
    /// Wall time, in seconds.
    pub seconds: f64,
    /// The part of it that searches for depths took.
    pub searching: f64,
}

impl Clock {
    /// The spent fraction of a budget (time or iterations), from 0; it can exceed 1. The time of
    /// searches for depths shortens the schedule, and is no part of it.
    pub fn progress(&self, budget: Budget) -> f64 {
        budget.progress(self.iteration, self.seconds, self.searching)
    }
}
