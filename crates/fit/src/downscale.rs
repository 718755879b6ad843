//! The size at which a fit reads its photographs.
//!
//! A phone's photographs have more pixels than a fit can look at, and more than a small machine can
//! hold: 50 of 12 megapixels are 600 million. The size follows from the options and the sizes of
//! the images alone, so that the same command reads the same pixels on every machine.

use crate::options::{DEFAULT_ITERATIONS, FitOptions};
use crate::run::MEMORY_PER_PIXEL;
use crate::schedule::FINEST_SHARE;

/// A set of at most this many training pixels is read whole, whatever the budget is: its memory is
/// 0.7 GB.
const FEW_PIXELS: u64 = 1 << 23;

/// The memory for photographs in bytes: the program stays below 4 GiB.
const MEMORY: u64 = 3 << 30;

/// The budget reduces the longest side of a photograph to no less than this many pixels.
const LEAST_SIDE: u32 = 480;

/// Bytes of memory for each pixel of a held-out view: an image in single precision and a mask.
const MEMORY_PER_HELD_OUT_PIXEL: u64 = 16;

/// The assumed speed, in draws of pixels a second, for a budget of time. The speed of the machine
/// itself would give other pixels on each machine.
const DRAWS_PER_SECOND: f64 = 1e5;

/// The reason for which photographs are read at a fraction of their size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The budget cannot draw more pixels.
    Budget,
    /// More pixels could take more than 4 GiB of memory.
    Memory,
}

impl FitOptions {
    /// The factor by which a fit reduces the width and height of its photographs, and the reason
    /// for a factor above 1 that is not the option's.
    ///
    /// Without the option `downscale` it is the least whole number for which the training pixels
    /// are no more than the budget draws on the finest level (but the longest side keeps 480
    /// pixels), and all photographs fit in 3 GiB. A set with up to 8 million training pixels is not
    /// reduced. `train` and `held_out` are the widths and heights of the photographs in pixels.
    pub fn downscale_for(&self, train: &[[u32; 2]], held_out: &[[u32; 2]]) -> (u32, Option<Limit>) {
        let within_memory = |n: u32| {
            let pixels = |sizes: &[[u32; 2]]| u128::from(pixels(sizes, n));
            let bytes = pixels(train) * u128::from(MEMORY_PER_PIXEL)
                + pixels(held_out) * u128::from(MEMORY_PER_HELD_OUT_PIXEL);
            bytes <= u128::from(MEMORY)
        };
        let within_budget = |n: u32| pixels(train, n) <= FEW_PIXELS.max(self.finest_draws());
        if let Some(n) = self.downscale {
            return (n, None);
        }
        if pixels(train, 1) <= FEW_PIXELS {
            return (1, None);
        }
        // At the largest factor every photograph is one pixel.
        let most = train.iter().chain(held_out).flatten().copied().max().unwrap_or(1);
        let least = |holds: &dyn Fn(u32) -> bool| (1..=most).find(|n| holds(*n)).unwrap_or(most);
        // Many photographs are better drawn in part than read too small.
        let budget = least(&within_budget).min((most / LEAST_SIDE).max(1));
        match (budget, least(&within_memory)) {
            (1, 1) => (1, None),
            (budget, memory) if budget >= memory => (budget, Some(Limit::Budget)),
            (_, memory) => (memory, Some(Limit::Memory)),
        }
    }

    /// The number of pixels that the budget draws on the finest level of the pyramid, about.
    fn finest_draws(&self) -> u64 {
        let draws = match self.time {
            Some(time) => DRAWS_PER_SECOND * time.as_secs_f64(),
            None => self.iterations.unwrap_or(DEFAULT_ITERATIONS) as f64 * self.batch as f64,
        };
        (FINEST_SHARE * draws) as u64
    }
}

/// The number of pixels of photographs of these sizes, read at 1/`n` of their width and height.
fn pixels(sizes: &[[u32; 2]], n: u32) -> u64 {
    let of = |size: &[u32; 2]| size.iter().map(|side| u64::from(side.div_ceil(n))).product();
    sizes.iter().fold(0, |sum: u64, size| sum.saturating_add(of(size)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// The sizes of 50 photographs of a phone, of which every eighth is held out.
    const PHONE: ([[u32; 2]; 43], [[u32; 2]; 7]) = ([[4032, 3024]; 43], [[4032, 3024]; 7]);

    fn of_phone(options: &FitOptions) -> (u32, Option<Limit>) {
        options.downscale_for(&PHONE.0, &PHONE.1)
    }

    #[test]
    fn the_factor_is_the_least_that_budget_and_memory_allow() {
        let of_iterations = |n: u64| FitOptions { iterations: Some(n), ..FitOptions::default() };
        let of_time = |seconds: u64| {
            let time = Some(Duration::from_secs(seconds));
            FitOptions { time, ..FitOptions::default() }
        };
        let (budget, memory) = (Some(Limit::Budget), Some(Limit::Memory));
        // 43 photographs of 504 × 378 pixels are 8.2 million.
        assert_eq!(of_phone(&FitOptions::default()), (8, budget));
        assert_eq!([of_phone(&of_iterations(1)), of_phone(&of_time(1))], [(8, budget); 2]);
        // 20,000 iterations of 1024 draws: 15 million on the finest level; 21 million are too many.
        assert_eq!(of_phone(&of_iterations(20_000)), (6, budget));
        assert_eq!(of_phone(&FitOptions { batch: 4096, ..of_iterations(5000) }), (6, budget));
        // 75,000 draws a second on the finest level: 45 million in ten minutes.
        assert_eq!(of_phone(&of_time(600)), (4, budget));
        assert_eq!(of_phone(&of_time(36_000)), (4, memory));
        assert_eq!(of_phone(&of_iterations(u64::MAX)), (4, memory));
    }

    #[test]
    fn the_photographs_fit_in_4_gib_with_every_budget() {
        for iterations in [1, 6000, 50_000, 1_000_000] {
            let options = FitOptions { iterations: Some(iterations), ..FitOptions::default() };
            for count in [10, 50, 300, 2000] {
                let sizes = vec![[4032, 3024]; count];
                let (n, _) = options.downscale_for(&sizes, &sizes);
                let bytes = pixels(&sizes, n) * (MEMORY_PER_PIXEL + MEMORY_PER_HELD_OUT_PIXEL);
                assert!(bytes <= MEMORY, "{count} photographs at 1/{n}: {bytes} bytes");
            }
        }
    }

    #[test]
    fn few_pixels_are_read_whole_and_the_option_decides_alone() {
        let short = FitOptions { iterations: Some(1), ..FitOptions::default() };
        assert_eq!(short.downscale_for(&[[400, 300]; 49], &[[400, 300]; 8]), (1, None));
        // 8,388,608 pixels, and one more.
        assert_eq!(short.downscale_for(&[[4096, 2048]], &[]), (1, None));
        assert_eq!(short.downscale_for(&[[4096, 2048], [1, 1]], &[]).0, 2);
        assert_eq!(short.downscale_for(&[], &[]), (1, None));
        for n in [1, 3] {
            let asked = FitOptions { downscale: Some(n), ..short.clone() };
            assert_eq!(of_phone(&asked), (n, None));
        }
        // The longest side of 200 photographs keeps 480 pixels.
        assert_eq!(short.downscale_for(&[[4032, 3024]; 200], &[]), (8, Some(Limit::Budget)));
        // Views of one pixel cannot be reduced.
        let many = vec![[1, 1]; (FEW_PIXELS + 1) as usize];
        assert_eq!(short.downscale_for(&many, &[]), (1, None));
    }
}
