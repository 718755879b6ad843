//! Cameras that are adjusted before the fit, from places of the same points in the photographs.

use calibrate::{
    Calibration, CameraDecision, Freedom, Matching, Observation, RefineCameras, Track, off_views,
};
use glam::DVec2;
use stereo::Places;

use super::Fit;
use crate::cameras::{Corrections, calibration};

/// The least number of places in a view. With fewer, it keeps its pose; a trial decides later if
/// that is the mean of all views.
const LEAST_PLACES: usize = 40;

/// The most places of all views, about; of more, every second, third or nth point is used. An
/// adjustment takes seconds then.
const MOST_PLACES: usize = 20_000;

/// Half of the side of the patch around a place that is compared, in searched pixels.
const PATCH: u32 = 7;

/// Every nth track, so that about `most` places are left.
fn thinned(tracks: Vec<Track>, most: usize) -> Vec<Track> {
    let tracks: Vec<Track> = tracks.into_iter().filter(|track| track.len() > 1).collect();
    let count = tracks.iter().map(Vec::len).sum::<usize>();
    tracks.into_iter().step_by(count.div_ceil(most).max(1)).collect()
}

/// The tracks without the views that have too few places in them, and without tracks of one place.
fn with_enough_places(mut tracks: Vec<Track>, views: usize) -> Vec<Track> {
    loop {
        let mut in_view = vec![0; views];
        tracks.iter().flatten().for_each(|o| in_view[o.view] += 1);
        let has_few = |view: usize| in_view[view] < LEAST_PLACES;
        if !tracks.iter().flatten().any(|o| has_few(o.view)) {
            return tracks;
        }
        tracks.iter_mut().for_each(|track| track.retain(|o| !has_few(o.view)));
        tracks.retain(|track| track.len() > 1);
    }
}

impl Fit {
    /// The parameters of cameras that places can adjust. Places fix focal lengths well, unlike the
    /// photometric loss. None if distortion is refined: the search for depths has no distortion.
    pub(crate) fn freedom_by_places(&self) -> Option<Freedom> {
        let choice = self.file.options.refine_cameras;
        let freedom = choice.freedom().filter(|freedom| !freedom.lens)?;
        Some(Freedom { focal: freedom.focal || choice == RefineCameras::Auto, ..freedom })
    }

    /// The cameras that are adjusted to places of points in the photographs of a level of the
    /// pyramid, and how much better they are. `None` if there are too few places.
    pub(crate) fn match_cameras(
        &self,
        level: usize,
        freedom: Freedom,
        places: Vec<Places>,
    ) -> Option<(Calibration, Matching)> {
        let scale = 2f64.powi(level as i32);
        let photographs = &self.levels[level].photographs;
        let observation = |(view, u): (usize, DVec2)| {
            let is_used = photographs[view].is_used_around(u.x as u32, u.y as u32, PATCH);
            is_used.then_some(Observation { view, u: u * scale })
        };
        let track = |places: Places| places.into_iter().filter_map(observation).collect();
        let tracks: Vec<Track> = places.into_iter().map(track).collect();
        let views = photographs.len();
        let tracks = with_enough_places(thinned(tracks, MOST_PLACES), views);
        if tracks.iter().map(Vec::len).sum::<usize>() < LEAST_PLACES * views {
            return None;
        }
        let start = |freedom| calibration(&self.dataset.train, self.file.sphere(), freedom);
        let all = vec![true; views];
        let given = start(Freedom::NONE).adjust(&tracks, scale, &all);
        let mut adjusted = start(freedom);
        let refined = adjusted.adjust(&tracks, scale, &all);
        let matching = Matching::of(&given, &refined, &adjusted);
        let off = off_views(&given, &refined);
        if matching.is_kept || !off.contains(&true) {
            return Some((adjusted, matching));
        }
        let mut adjusted = start(freedom.without_lens());
        let refined = adjusted.adjust(&tracks, scale, &off);
        let matching = Matching::of_views(&given, &refined, &adjusted, &off);
        Some((adjusted, matching))
    }

    /// Takes the adjusted cameras if they are kept. If they are not, the loss refines cameras later
    /// if that was asked for, and decides if places of photographs at reduced size say too little.
    pub(crate) fn decide_cameras(
        &mut self,
        adjusted: Calibration,
        matching: Matching,
        level: usize,
    ) {
        let is_auto = self.file.options.refine_cameras == RefineCameras::Auto;
        self.corrections = match matching.is_kept {
            true => Corrections::Adjusted(adjusted),
            false if is_auto && level == 0 => Corrections::Given,
            false => Corrections::Undecided,
        };
        self.decision = Some(CameraDecision::Matching(matching));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_with_few_places_and_their_partners_leave_all_tracks() {
        // Views 0 and 1 share 60 points, views 2 and 3 share 50, and view 4 shares 45 with view 5,
        // which has no other: of 10 of them, view 6 has a third place.
        let track = |views: &[usize]| -> Track {
            views.iter().map(|view| Observation { view: *view, u: DVec2::ZERO }).collect()
        };
        let many = |n, views: &[usize]| std::iter::repeat_n(track(views), n).collect::<Vec<_>>();
        let tracks = [many(60, &[0, 1]), many(39, &[2, 3]), many(45, &[4, 5]), many(10, &[4, 6])];
        let kept = with_enough_places(tracks.concat(), 7);
        let in_view = |view| kept.iter().flatten().filter(|o| o.view == view).count();
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(in_view), [60, 60, 0, 0, 45, 45, 0]);
        // Without the 39 of view 6, view 4 has 39 too.
        let tracks = [many(39, &[4, 6]), many(20, &[4, 5])].concat();
        assert!(with_enough_places(tracks, 7).is_empty());
        assert_eq!(thinned(many(100, &[0, 1, 2]), 100).len(), 34);
        assert_eq!(thinned(many(100, &[0]), 10).len(), 0);
    }
}
