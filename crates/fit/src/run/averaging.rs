//! The mean of the parameters over the last part of a fit (Polyak and Juditsky, "Acceleration of
//! Stochastic Approximation by Averaging", SIAM Journal on Control and Optimization 30(4), 1992).
//!
//! Steps with random pixels lead around an optimum. The mean of the places is nearer to it than the
//! last one.

use crate::checkpoint::Average;
use loss::schedule::is_averaged;
use rayon::prelude::*;

use super::Fit;

/// The number of parameters that a thread takes at a time.
const PART: usize = 1 << 14;

impl Fit {
    /// Adds the parameters after a step to their mean, in the last part of the budget.
    pub(super) fn add_to_average(&mut self) {
        if !is_averaged(self.progress()) {
            // A longer budget puts the run back.
            self.average = None;
            return;
        }
        let count = self.parameters.len();
        let Average { parameters, steps } =
            self.average.get_or_insert_with(|| Average { parameters: vec![0.0; count], steps: 0 });
        *steps += 1;
        let share = 1.0 / *steps as f32;
        parameters.par_chunks_mut(PART).zip(self.parameters.par_chunks(PART)).for_each(
            |(mean, own)| mean.iter_mut().zip(own).for_each(|(a, p)| *a += share * (*p - *a)),
        );
    }

    /// Takes the mean as the model, if the budget is spent.
    pub(super) fn take_average(&mut self) {
        if let Some(average) = self.average.as_ref().filter(|_| self.progress() >= 1.0) {
            self.model.set_parameters(&average.parameters);
        }
    }
}
