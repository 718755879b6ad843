//! The budget of a fit: its time, or its iterations.

use std::time::Duration;

use crate::architecture::is_fine;
use crate::options::{DEFAULT_ITERATIONS, FitOptions};

/// The assumed number of iterations in a second on one thread, for a budget of time: with the speed
/// of the machine itself, the same options would mean another schedule on each machine. Only a
/// search for depths that takes too long follows the clock.
const ITERATIONS_PER_SECOND: f64 = 50.0;

/// The most threads that make a fit faster.
const MOST_THREADS: usize = 16;

/// The share of the budget with a soft surface. docs/captures-compared.md has other shares.
const SOFT: f64 = 0.5;

/// In front of a uniform background, the surface is soft for about this many iterations, and for
/// this share at least. docs/detail.md compares a long fit with another one that is soft for a
/// half.
const SOFT_ITERATIONS: f64 = 5000.0;
const LEAST_SOFT: f64 = 0.2;

/// The end of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// Its wall time: that of the searches for depths, and of all iterations.
    Time(Duration),
    /// Their number.
    Iterations(u64),
}

impl Budget {
    /// The share of the budget that is spent after these iterations and `seconds`, of which
    /// searches for depths took the seconds `searching`. At 1 and above, the fit is finished.
    ///
    /// Of a time, it is the share of the rest after the searches: the first iteration has the share
    /// 0.
    pub fn progress(self, iterations: u64, seconds: f64, searching: f64) -> f64 {
        match self {
            Budget::Time(time) if searching >= time.as_secs_f64() => 1.0,
            Budget::Time(time) => (seconds - searching).max(0.0) / (time.as_secs_f64() - searching),
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

    /// The same options with the number of threads that the schedule of a budget of time assumes:
    /// the recorded number, or the threads of the current pool. The schedule of a run must not
    /// change with the threads of a resumption.
    #[must_use]
    pub fn with_schedule(mut self) -> Self {
        if self.time.is_some() {
            self.schedule_threads.get_or_insert_with(rayon::current_num_threads);
        }
        self
    }

    /// The number of iterations of the budget. For a budget of time it is assumed, from the
    /// recorded number of threads: a fit is faster by about the root of it (docs/iteration.md).
    pub(crate) fn assumed_iterations(&self) -> u64 {
        self.assumed(f64::sqrt)
    }

    /// The same for work that threads share without waiting for each other.
    pub(crate) fn assumed_shared_iterations(&self) -> u64 {
        self.assumed(|threads| threads)
    }

    /// The number of iterations of the budget, of a time by how much faster threads are than one.
    fn assumed(&self, speed: fn(f64) -> f64) -> u64 {
        let threads = self.schedule_threads.unwrap_or_else(rayon::current_num_threads);
        let rate = ITERATIONS_PER_SECOND * speed(threads.min(MOST_THREADS) as f64);
        match self.budget() {
            Budget::Time(time) => (time.as_secs_f64() * rate) as u64,
            Budget::Iterations(all) => all,
        }
    }

    /// The share of the budget with a soft surface. The file of a run has the option.
    pub fn soft(&self) -> f64 {
        self.soft.unwrap_or(SOFT)
    }

    /// The share of a new run: that of the option, or one for its budget and its background, which
    /// is trained or not. Rooms need more of it: the order of things in depth is open for longer.
    pub(crate) fn soft_for(&self, is_trained: bool) -> f64 {
        let of_iterations = SOFT_ITERATIONS / self.assumed_iterations() as f64;
        let least = if is_trained { SOFT } else { LEAST_SOFT };
        self.soft.unwrap_or(of_iterations.clamp(least, SOFT))
    }

    /// The factor on the learning rate of the field's network: less than 1 only where splines near
    /// the surface carry the details.
    pub(crate) fn network_rate(&self, progress: f64) -> f64 {
        self.fall(loss::schedule::network_rate, progress)
    }

    /// The weight of the bending term. It falls where the network's rate falls: without that, plain
    /// surfaces would get their dents back.
    pub(crate) fn bending_weight(&self, progress: f64) -> f64 {
        self.bending * self.fall(loss::schedule::bending_weight, progress)
    }

    /// The factor on the weight of the term of patches where radiance explains the photographs.
    pub(crate) fn patch_fall(&self, progress: f64) -> f64 {
        loss::schedule::patch_fall(progress, self.soft(), self.assumed_iterations())
    }

    /// A factor of the schedule for fields with splines near the surface, or 1 without them.
    fn fall(&self, factor: fn(f64, f64, u64) -> f64, progress: f64) -> f64 {
        let has_fine_grid = self.grid.0.iter().any(|side| is_fine(*side));
        let now = || factor(progress, self.soft(), self.assumed_iterations());
        if has_fine_grid { now() } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sdf_nn::grids::GridLevels;

    #[test]
    fn searches_shorten_a_schedule_by_time_and_no_other() {
        let minute = Budget::Time(Duration::from_secs(60));
        let progress = |seconds, searching| minute.progress(9, seconds, searching);
        assert_eq!([progress(0.0, 0.0), progress(30.0, 0.0), progress(60.0, 0.0)], [0.0, 0.5, 1.0]);
        assert_eq!([progress(20.0, 20.0), progress(40.0, 20.0)], [0.0, 0.5]);
        assert_eq!(
            [progress(60.0, 20.0), progress(70.0, 70.0), progress(0.0, 20.0)],
            [1.0, 1.0, 0.0]
        );
        assert_eq!(Budget::Iterations(18).progress(9, 70.0, 70.0), 0.5);
    }

    #[test]
    fn the_schedule_of_a_time_does_not_depend_on_the_threads_of_a_resumption() {
        let options = FitOptions { time: Some(Duration::from_secs(600)), ..FitOptions::default() };
        let of_threads = |n: usize, options: &FitOptions| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| options.clone().with_schedule())
        };
        let [one, four] = [1, 4].map(|n| of_threads(n, &options));
        assert_eq!([&one, &four].map(FitOptions::assumed_iterations), [30_000, 60_000]);
        assert_eq!([&one, &four].map(FitOptions::assumed_shared_iterations), [30_000, 120_000]);
        let resumed = of_threads(4, &one);
        assert_eq!(resumed, one);
        assert_eq!(resumed.soft_for(false), one.soft_for(false));
        // A number of iterations needs no threads.
        assert_eq!(FitOptions::default().with_schedule(), FitOptions::default());
    }

    #[test]
    fn long_fits_before_a_uniform_background_are_soft_for_less_of_the_budget() {
        let of = |n| FitOptions { iterations: Some(n), ..FitOptions::default() };
        let shares = [1, 10_000, 20_000, 100_000].map(|n| of(n).soft_for(false));
        assert_eq!(shares, [0.5, 0.5, 0.25, 0.2]);
        assert_eq!(of(100_000).soft_for(true), 0.5);
        let given = FitOptions { soft: Some(0.0), ..of(100_000) };
        assert_eq!([given.soft_for(false), given.soft_for(true), given.soft()], [0.0; 3]);
    }

    #[test]
    fn a_given_learning_rate_goes_before_that_of_the_background() {
        let none = FitOptions::default();
        assert_eq!([none.learning_rate_for(false), none.learning_rate_for(true)], [3e-3, 2e-3]);
        let given = FitOptions { learning_rate: Some(1e-3), ..none };
        assert_eq!([given.learning_rate_for(false), given.learning_rate()], [1e-3; 2]);
    }

    #[test]
    fn the_network_slows_down_and_bending_ends_where_splines_carry_the_details() {
        let of = |levels: &[usize]| FitOptions {
            grid: GridLevels(levels.to_vec()),
            soft: Some(0.6),
            iterations: Some(20_000),
            ..FitOptions::default()
        };
        let (fine, coarse) = (of(&[32, 64]), of(&[32]));
        for progress in [0.0, 0.3, 0.6] {
            let factors = (fine.network_rate(progress), fine.bending_weight(progress));
            assert_eq!(factors, (1.0, fine.bending), "soft");
        }
        assert!(fine.network_rate(1.0) < 0.1 && fine.bending_weight(1.0) < 0.1 * fine.bending);
        assert_eq!((coarse.network_rate(1.0), coarse.bending_weight(1.0)), (1.0, coarse.bending));
        assert_eq!(of(&[]).network_rate(1.0), 1.0);
        let short = FitOptions { iterations: Some(300), ..fine };
        assert_eq!((short.network_rate(1.0), short.bending_weight(1.0)), (1.0, short.bending));
    }
}
