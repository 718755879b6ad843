//! The size at which a fit reads its photographs.

use loss::photometry::{Limit, downscale};

use crate::budget::Budget;
use crate::options::FitOptions;
use loss::schedule::FINEST_SHARE;

/// The assumed speed, in draws of pixels a second, for a budget of time. The speed of the machine
/// itself would give other pixels on each machine.
const DRAWS_PER_SECOND: f64 = 1e5;

impl FitOptions {
    /// The factor by which a fit reduces the width and height of its photographs, and the reason
    /// for a factor above 1 that is not the option's; see [`downscale`]. `train` and `held_out` are
    /// the widths and heights of the photographs in pixels.
    pub fn downscale_for(&self, train: &[[u32; 2]], held_out: &[[u32; 2]]) -> (u32, Option<Limit>) {
        match self.downscale {
            Some(n) => (n, None),
            None => downscale(train, held_out, self.finest_draws()),
        }
    }

    /// The number of pixels that the budget draws on the finest level of the pyramid, about.
    fn finest_draws(&self) -> u64 {
        let draws = match self.budget() {
            Budget::Time(time) => DRAWS_PER_SECOND * time.as_secs_f64(),
            Budget::Iterations(all) => all as f64 * self.batch as f64,
        };
        (FINEST_SHARE * draws) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_factor_follows_from_the_budget_and_the_option_decides_alone() {
        let of = |options: &FitOptions| options.downscale_for(&[[4032, 3024]; 43], &[]).0;
        let of_iterations = |n: u64| FitOptions { iterations: Some(n), ..FitOptions::default() };
        assert_eq!([of(&FitOptions::default()), of(&of_iterations(1))], [8, 8]);
        assert_eq!(of(&of_iterations(20_000)), 6);
        assert_eq!(of(&FitOptions { batch: 4096, ..of_iterations(5000) }), 6);
        // 75,000 draws a second on the finest level.
        let time = Some(Duration::from_secs(600));
        assert_eq!(of(&FitOptions { time, ..FitOptions::default() }), 4);
        for n in [1, 3] {
            let asked = FitOptions { downscale: Some(n), ..FitOptions::default() };
            assert_eq!(asked.downscale_for(&[[4032, 3024]; 43], &[]), (n, None));
        }
    }
}
