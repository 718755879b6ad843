//! The alignment of held-out cameras to a model whose cameras were refined.

use estimate::{Refined, SampleCounts};
use loss::photometry::{Draw, MaskUse, pyramid};
use loss::{Objective, Surface, Wanted, Workspace, gradient};
use random::Stream;
use render::{Camera, Scene};

use dataset::View;
use multiview::calibrate::{Calibration, Freedom};

use crate::cameras::corrected;
use crate::error::FitError;
use crate::model::Model;
use crate::run_file::RunFile;
use crate::solid::SLOPE_POINTS;
use crate::streams::CAMERA_TRIAL;

/// Steps of an alignment.
const STEPS: u64 = 200;

/// The rate of the first step, in pixels; it falls to zero.
const RATE: f64 = 0.1;

/// Pixels of each view in a step.
const PIXELS: u64 = 256;

/// Aligns the poses of views to the model of a run, and returns their cameras.
///
/// A model of refined cameras stands where these put it. Held-out cameras have their errors still,
/// so their photographs would be compared with images from elsewhere. `progress` gets the fraction
/// that is done.
///
/// # Errors
/// If the field or a gradient is not finite.
pub fn align(
    model: &Model,
    file: &RunFile,
    views: &[View],
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<Camera>, FitError> {
    let given: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let colors = file.background_of(views);
    let background = file.background_model(views, model.background.picture().cloned());
    let level = &pyramid(views, MaskUse::None, &background, 1)[0];
    if level.pixel_count() == 0 {
        return Ok(given);
    }
    let mut calibration = Calibration::new(given, file.sphere(), Freedom::POSES).without_gauge();
    let stream = Stream::of_seed(file.options.seed).named(CAMERA_TRIAL);
    let draws = PIXELS * views.len() as u64;
    let mut work = Workspace::default();
    for step in 0..STEPS {
        let draw = |i| level.draw(i, 1, stream.at(3));
        let pixels: Vec<Draw> = (step * draws..(step + 1) * draws).map(draw).collect();
        let cameras = corrected(Some(&calibration), &level.cameras);
        let own = model.background.as_background();
        let behind = colors.as_ref().map_or(own, |colors| colors);
        let scene = Scene::new(&model.field, &model.head, &cameras, &file.sphere(), behind);
        let surface = Surface::Sharp {
            estimator: &Refined,
            counts: SampleCounts { spp: 4, edge_samples: 1 },
            pass: file.options.pass(),
        };
        let scene = scene.with_slope_of_field(SLOPE_POINTS);
        let objective = Objective {
            wanted: Wanted { background: false, cameras: true },
            stream: stream.at(4).at(step),
            ..Objective::photometric(scene, level, &pixels, surface)
        };
        let found = gradient(&objective, &mut work)?;
        work.reuse(found.parameters);
        let rate = RATE * (1.0 - step as f64 / STEPS as f64);
        calibration.step(&level.cameras, &found.cameras, rate)?;
        progress((step + 1) as f64 / STEPS as f64);
    }
    Ok(calibration.cameras())
}
