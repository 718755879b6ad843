//! Cameras that are adjusted before the fit, from places of the same points in the photographs.

use calibrate::{
    Calibration, CameraDecision, Freedom, Matching, Observation, RefineCameras, Track,
};
use glam::DVec2;
use stereo::Places;

use super::Fit;
use crate::cameras::{Corrections, calibration};

/// The least number of places in a view. With fewer, it keeps its pose; a trial decides later if
/// that is the mean of all views.
const LEAST_PLACES: usize = 40;

/// The most places of all views, about; of more, every second or third point is used. An adjustment
/// takes seconds then.
const MOST_PLACES: usize = 20_000;

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
            let is_used = photographs[view].is_used(u.x as u32, u.y as u32);
            is_used.then_some(Observation { view, u: u * scale })
        };
        let track = |places: Places| places.into_iter().filter_map(observation).collect();
        let mut tracks: Vec<Track> = places.into_iter().map(track).collect();
        tracks.retain(|track| track.len() > 1);
        let mut in_view = vec![0; photographs.len()];
        tracks.iter().flatten().for_each(|o| in_view[o.view] += 1);
        tracks.iter_mut().for_each(|track| track.retain(|o| in_view[o.view] >= LEAST_PLACES));
        tracks.retain(|track| track.len() > 1);
        let count = tracks.iter().map(Vec::len).sum::<usize>();
        let least = LEAST_PLACES * self.dataset.train.len();
        if count < least {
            return None;
        }
        let every = count.div_ceil(MOST_PLACES.max(least));
        let tracks: Vec<Track> = tracks.into_iter().step_by(every).collect();
        let start = |freedom| calibration(&self.dataset.train, self.file.sphere(), freedom);
        let given = start(Freedom::NONE).adjust(&tracks, scale);
        let mut adjusted = start(freedom);
        let refined = adjusted.adjust(&tracks, scale);
        let matching = Matching::of(&given, &refined, &adjusted);
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
