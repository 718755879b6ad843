//! Cameras that keypoint matches adjust before the first iteration.

use glam::DVec2;
use multiview::calibrate::{
    Calibration, Freedom, Matching, Observation, RefineCameras, Track, off_views,
};
use multiview::stereo::{HALF_PATCH, Places};

use crate::camera_corrections::Corrections;
use crate::cameras::calibration;
use crate::photographs::Photographs;
use crate::run_file::RunFile;

/// The least number of keypoint matches in a view. With fewer, it keeps its pose. In a room with wrong poses,
/// views with fewer than 40 matches were well adjusted.
const LEAST_MATCHES: usize = 12;

/// The least mean number of matches in a view. With fewer, a trial decides later.
const LEAST_MEAN: usize = 40;

/// The most matches of all views, about; of more, every second, third or nth point is used. An
/// adjustment takes seconds then. Views with less than this mean number keep all of theirs.
const MOST_MATCHES: usize = 20_000;

/// The number of matches in each of the views.
fn in_views(tracks: &[Track], views: usize) -> Vec<usize> {
    let mut counts = vec![0; views];
    tracks.iter().flatten().for_each(|o| counts[o.view] += 1);
    counts
}

/// Every nth track, so that about `most` matches are left, and all tracks of views that have less
/// than the mean of that.
fn thinned(mut tracks: Vec<Track>, views: usize, most: usize) -> Vec<Track> {
    tracks.retain(|track| track.len() > 1);
    let counts = in_views(&tracks, views);
    let every = counts.iter().sum::<usize>().div_ceil(most).max(1);
    let is_rare = |track: &Track| track.iter().any(|o| counts[o.view] < most / views);
    let kept = tracks.into_iter().enumerate();
    kept.filter(|(i, track)| i % every == 0 || is_rare(track)).map(|(_, track)| track).collect()
}

/// The tracks without the views that have too few matches in them, and without tracks of one match.
fn with_enough_matches(mut tracks: Vec<Track>, views: usize) -> Vec<Track> {
    loop {
        let in_view = in_views(&tracks, views);
        let has_few = |view: usize| in_view[view] < LEAST_MATCHES;
        if !tracks.iter().flatten().any(|o| has_few(o.view)) {
            return tracks;
        }
        tracks.iter_mut().for_each(|track| track.retain(|o| !has_few(o.view)));
        tracks.retain(|track| track.len() > 1);
    }
}

/// The cameras that are adjusted to keypoint matches in the photographs of a level of the pyramid,
/// and how much better they are. `None` if there are too few matches.
pub(crate) fn match_cameras(
    file: &RunFile,
    photographs: &Photographs,
    level: usize,
    freedom: Freedom,
    tracks: Vec<Places>,
) -> Option<(Calibration, Matching)> {
    let scale = 2f64.powi(level as i32);
    let images = &photographs.levels[level].photographs;
    let observation = |(view, u): (usize, DVec2)| {
        let is_used = images[view].is_used_around(u.x as u32, u.y as u32, HALF_PATCH);
        is_used.then_some(Observation { view, u: u * scale })
    };
    let track = |places: Places| places.into_iter().filter_map(observation).collect();
    let tracks: Vec<Track> = tracks.into_iter().map(track).collect();
    let views = images.len();
    let tracks = with_enough_matches(thinned(tracks, views, MOST_MATCHES), views);
    if tracks.iter().map(Vec::len).sum::<usize>() < LEAST_MEAN * views {
        return None;
    }

    let start = |freedom| calibration(&photographs.dataset.train, file.sphere(), freedom);
    let all = vec![true; views];
    let given = start(Freedom::NONE).adjust(&tracks, scale, &all);
    let mut adjusted = start(freedom);
    let refined = adjusted.adjust(&tracks, scale, &all);
    let matching = Matching::of(&given, &refined, &adjusted);
    let off = off_views(&given, &refined);
    if matching.is_kept || !off.contains(&true) {
        return Some((adjusted, matching));
    }

    let mut adjusted = start(Freedom::POSES);
    let refined = adjusted.adjust(&tracks, scale, &off);
    let matching = Matching::of_views(&given, &refined, &adjusted, &off);
    Some((adjusted, matching))
}

/// The adjusted cameras, if they are kept. If they are not, the loss refines cameras later if that
/// was asked for, and decides if matches in photographs at reduced size say too little.
pub(crate) fn decide_cameras(
    choice: RefineCameras,
    adjusted: Calibration,
    matching: &Matching,
    level: usize,
) -> Corrections<Calibration> {
    match matching.is_kept {
        true => Corrections::Adjusted(adjusted),
        false if choice == RefineCameras::Auto && level == 0 => Corrections::Given,
        false => Corrections::Undecided,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point that these views show.
    fn track(views: &[usize]) -> Track {
        views.iter().map(|view| Observation { view: *view, u: DVec2::ZERO }).collect()
    }

    #[test]
    fn views_with_few_matches_and_their_partners_leave_all_tracks() {
        let many = |n, views: &[usize]| std::iter::repeat_n(track(views), n).collect::<Vec<_>>();
        let tracks = [many(60, &[0, 1]), many(11, &[2, 3]), many(13, &[4, 5]), many(3, &[4, 6])];
        let kept = with_enough_matches(tracks.concat(), 7);
        assert_eq!(in_views(&kept, 7), [60, 60, 0, 0, 13, 13, 0]);
        // Without the 4 matches of view 5, view 4 has 11.
        let tracks = [many(11, &[4, 6]), many(4, &[4, 5])].concat();
        assert!(with_enough_matches(tracks, 7).is_empty());
    }

    #[test]
    fn tracks_of_views_with_few_matches_are_not_thinned() {
        let tracks = [vec![track(&[0, 1]); 100], vec![track(&[1, 2]); 10], vec![track(&[0])]];
        assert_eq!(in_views(&thinned(tracks.concat(), 3, 50), 3), [20, 30, 10]);
    }
}
