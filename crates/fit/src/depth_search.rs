//! The search for depth maps before the first iteration.

use std::time::{Duration, Instant};

use loss::photometry::Level;
use loss::schedule::ends_depths;
use multiview::calibrate::{Calibration, CameraDecision};
use multiview::stereo::Stereo;
use random::Stream;

use crate::budget::Budget;
use crate::camera_matching::{decide_cameras, match_cameras};
use crate::cameras::{corrected, freedom_by_matches};
use crate::depths::Depths;
use crate::fit::Fit;
use crate::options::FitOptions;
use crate::photographs::stereo_views;
use crate::run_file::RunFile;

/// Pixels of photographs for each iteration of the budget: the search takes about a tenth of the
/// fit's time. Larger photographs are searched at a half, a quarter or an eighth of their size, or
/// not at all.
const PIXELS_PER_ITERATION: u64 = 240;

/// The largest shares of a budget of time for the first search, and for all of them. A search that
/// would take longer begins anew at half of the size.
const LARGEST_SHARES: [f64; 2] = [0.15, 0.3];

/// The most pixels of photographs, whatever the budget is: 32 bytes of memory for each.
const MOST_PIXELS: u64 = 1 << 23;

/// Adjustments of the cameras, each by the planes that the search finds with those of the one
/// before. docs/captures-compared.md compares numbers of them.
const ROUNDS: usize = 2;

impl FitOptions {
    /// The largest number of pixels of photographs that are searched for depths.
    fn searched_pixels(&self) -> u64 {
        self.assumed_shared_iterations().saturating_mul(PIXELS_PER_ITERATION).min(MOST_PIXELS)
    }
}

impl RunFile {
    /// Whether depths guide the soft surface of the run.
    fn uses_depths(&self) -> bool {
        self.options.stereo.is_used(self.background_kind.is_trained()) && self.options.soft() > 0.0
    }
}

/// Whether a search would take longer than `limit`, if `done` of all its photographs took
/// `elapsed`. Once half of them are done, it is not given up.
fn is_late(elapsed: Duration, done: usize, all: usize, limit: Duration) -> bool {
    let is_early = (1..=all / 2).contains(&done);
    is_early && elapsed.as_secs_f64() * all as f64 > limit.as_secs_f64() * done as f64
}

impl Fit {
    /// Whether this part of the run needs depths that it has not looked for.
    pub fn lacks_depths(&self) -> bool {
        let is_over = ends_depths(self.progress(), self.file.options.soft());
        self.file.uses_depths() && !is_over && self.photographs.depths.is_none()
    }

    /// Finds the depths that guide the soft surface, if this part of the run needs them. `report`
    /// gets the number of photographs that are done, and that of all. If `stop` is true, nothing is
    /// found. The time counts as time of the fit. A resumed run finds them again.
    ///
    /// If cameras are refined, keypoint matches adjust them. If that makes them
    /// better, the search begins anew, up to two times.
    ///
    /// [`Session::run`](crate::Session::run) calls it; another call before it shows the progress.
    pub fn find_depths(&mut self, stop: &dyn Fn() -> bool, report: &mut dyn FnMut(usize, usize)) {
        if self.lacks_depths() {
            let begin = Instant::now();
            self.photographs.depths = self.searched_depths(stop, report);
            let taken = begin.elapsed().as_secs_f64();
            self.clock.seconds += taken;
            self.clock.searching += taken;
        }
    }

    /// The depth maps, after an adjustment of the cameras; `None` if `stop` was true.
    fn searched_depths(
        &mut self,
        stop: &dyn Fn() -> bool,
        report: &mut dyn FnMut(usize, usize),
    ) -> Option<Depths> {
        let most = self.file.options.searched_pixels();
        let fits = |level: &Level| level.photograph_pixels() <= most;
        let levels = &self.photographs.levels;
        let Some(mut level) = levels.iter().position(fits) else { return Some(Depths::NONE) };
        let begin = Instant::now();
        let [of_first, of_all] = LARGEST_SHARES.map(|share| match self.file.options.budget() {
            Budget::Time(time) => time.mul_f64(share),
            Budget::Iterations(_) => Duration::MAX,
        });
        // A run that is resumed has decided before its first iteration.
        let is_open = self.photographs.corrections.is_undecided() && self.clock.iteration == 0;
        let choice = self.file.options.refine_cameras;
        let freedom = freedom_by_matches(choice).filter(|_| is_open);
        // Cameras that the loss refines moved after the search of a run without an interruption.
        let cameras = self.photographs.corrections.adjusted();
        let mut search = self.search(&mut level, cameras, of_first, stop, report)?;
        let mut adjusted = None;
        for freedom in std::iter::repeat_n(freedom, ROUNDS).flatten() {
            let tracks = search.tracks();
            let matched = match_cameras(&self.file, &self.photographs, level, freedom, tracks);
            let Some((cameras, matching)) = matched else { break };
            let (is_kept, matched_level) = (matching.is_kept, level);
            if is_kept || adjusted.is_some() {
                let limit = of_all.saturating_sub(begin.elapsed());
                let cameras = is_kept.then_some(&cameras);
                search = self.search(&mut level, cameras, limit, stop, report)?;
            }
            adjusted = Some((cameras, matching, matched_level));
            if !is_kept {
                break;
            }
        }
        // A later search may be on a coarser level.
        if let Some((cameras, matching, matched_level)) = adjusted {
            let decided = decide_cameras(choice, cameras, &matching, matched_level);
            self.photographs.corrections = decided;
            self.photographs.decision = Some(CameraDecision::Matching(matching));
        }
        let mut maps = search.depth_maps();
        for (map, photograph) in maps.iter_mut().zip(&self.photographs.levels[level].photographs) {
            map.forget_unless(|x, y| photograph.is_used(x, y));
        }
        Some(Depths::new(maps, level))
    }

    /// The planes of all photographs of a level; `None` if `stop` was true. A search that would
    /// take longer than `limit` begins anew on the next level, which `level` is then.
    fn search(
        &self,
        level: &mut usize,
        calibration: Option<&Calibration>,
        limit: Duration,
        stop: &dyn Fn() -> bool,
        report: &mut dyn FnMut(usize, usize),
    ) -> Option<Stereo> {
        let (mut search, mut begin) = (self.stereo(*level, calibration), Instant::now());
        loop {
            let (done, all) = search.progress();
            report(done, all);
            if done == all {
                return Some(search);
            }
            if stop() {
                return None;
            }
            if *level + 1 < self.photographs.levels.len()
                && is_late(begin.elapsed(), done, all, limit)
            {
                *level += 1;
                (search, begin) = (self.stereo(*level, calibration), Instant::now());
            }
            search.search(rayon::current_num_threads());
        }
    }

    /// A search in the photographs of a level.
    fn stereo(&self, level: usize, calibration: Option<&Calibration>) -> Stereo {
        let Level { cameras, photographs, .. } = &self.photographs.levels[level];
        let cameras = corrected(calibration, cameras);
        Stereo::new(
            &stereo_views(&cameras, photographs),
            &self.file.sphere(),
            Stream::of_seed(self.file.options.seed),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_is_late_by_what_it_took_so_far_until_half_of_it_is_done() {
        let late = |seconds, done, limit| {
            is_late(Duration::from_secs(seconds), done, 48, Duration::from_secs(limit))
        };
        assert!(late(2, 4, 20) && late(2, 2, 20) && late(1, 24, 0));
        assert!(!late(2, 4, 24) && !late(9, 0, 1) && !late(9, 25, 1));
        assert!(!is_late(Duration::from_secs(9), 1, 48, Duration::MAX));
    }
}
