//! Derivative images by central differences of rendered images.

use std::cell::RefCell;
use std::time::Instant;

use estimate::EstimatorPrecision;
use estimate::gradient::{Difference, finite_difference};
use field::{Counted, Evaluations, Field, SLOPE_POINTS};
use files::InputError;
use film::Film;
use render::{Scene, render};
use scene::{SceneFile, ScenePrecision};
use serde_json::Value;

use super::options::Gradient;
use super::report::GradientReport;

/// Step of a number under /sdf, in widths of a pixel at the distance of the surface.
const FIELD_STEP_PIXELS: f64 = 0.05;

/// Step of a number of the appearance or of the background, in its own unit.
const APPEARANCE_STEP: f64 = 1e-2;

/// Number of steps that are tried, each half of the one before, until the scene is valid on both
/// sides.
const STEPS_TRIED: i32 = 20;

impl Gradient {
    /// Computes central differences (I(+h) − I(−h))/2h of the image and writes them: a number of
    /// the scene file is changed by ±h, and both images have the same random samples.
    ///
    /// The error is of second order in h; see `estimate::gradient::finite_difference` for the noise. The
    /// report has the evaluations of the changed scenes.
    pub(super) fn differences<R: EstimatorPrecision + ScenePrecision>(
        &self,
        file: &SceneFile,
        tracing: trace::Options<R>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<GradientReport> {
        // Refuse a pointer that names no parameter, as with any other estimator.
        self.directions(file)?;
        let start = Instant::now();
        let value = files::json::read(&self.scene)?;
        let pixel = file.camera.pixel_angle() * surface_distance(file)?;
        let evaluations = RefCell::new(Evaluations::default());
        let (mut derivatives, mut notes) = (Vec::new(), Vec::new());
        for (done, wrt) in self.wrt.iter().enumerate() {
            let share = |fraction: f64| progress((done as f64 + fraction) / self.wrt.len() as f64);
            let step =
                if wrt.starts_with("/sdf/") { FIELD_STEP_PIXELS * pixel } else { APPEARANCE_STEP };
            let step = self.valid_step(&value, wrt, step)?;
            let difference = finite_difference(self.sampling(), step, &share, |offset, part| {
                let changed = self.changed_scene(&value, wrt, offset)?;
                let (film, used) = image::<R>(&changed, tracing, part.counts.spp, part.seed)
                    .map_err(|e| self.field_error(e))?;
                *evaluations.borrow_mut() += used;
                anyhow::Ok(film)
            })?;
            notes.extend(note(wrt, step, &difference));
            derivatives.push(difference.derivative);
        }
        let report = self.write_images(&derivatives, start.elapsed().as_secs_f64())?;
        Ok(GradientReport { evaluations: evaluations.into_inner(), notes, ..report })
    }

    /// The scene with `offset` added to the number at the JSON pointer `wrt`.
    fn changed_scene(
        &self,
        value: &Value,
        wrt: &str,
        offset: f64,
    ) -> Result<SceneFile, InputError> {
        let mut value = value.clone();
        if let Some(number) = value.pointer_mut(wrt) {
            *number = (number.as_f64().unwrap_or_default() + offset).into();
        }
        SceneFile::from_value(&self.scene, &value)
    }

    /// `step`, halved until the scene is valid with the number changed by ±`step`. For example, a
    /// radius stays above 0 only if the step is smaller than the radius.
    fn valid_step(&self, value: &Value, wrt: &str, step: f64) -> Result<f64, InputError> {
        let mut steps = (0..STEPS_TRIED).map(|i| step * 0.5f64.powi(i));
        let valid = |step: f64| {
            self.changed_scene(value, wrt, step).is_ok()
                && self.changed_scene(value, wrt, -step).is_ok()
        };
        steps.find(|step| valid(*step)).ok_or_else(|| {
            let found = value.pointer(wrt).map_or_else(String::new, ToString::to_string);
            let expected = "a number that finite differences can both increase and decrease";
            InputError::new(&self.scene, wrt, found, expected)
        })
    }

    /// Makes an [`InputError`] of the error of a field that is not finite.
    fn field_error(&self, error: anyhow::Error) -> anyhow::Error {
        match error.downcast::<render::InvalidField>() {
            Ok(e) => InputError::new(&self.scene, "/sdf", e, "a finite field").into(),
            Err(error) => error,
        }
    }
}

/// The sentence about a step that is not the usual one, or too long still.
fn note(wrt: &str, step: f64, difference: &Difference) -> Option<String> {
    let halved = format!("{:.3e} in place of {step:.3e}", difference.step);
    match difference {
        Difference { is_one_sided: true, .. } => Some(format!(
            "{wrt}: the image changes more than twice as much on one side of the number as on the \
             other, with a step of {halved}, too: it may have no derivative here"
        )),
        Difference { step: used, .. } if *used < step => Some(format!(
            "{wrt}: the step is {halved}, with which a thin part of the scene appears or vanishes"
        )),
        Difference { .. } => None,
    }
}

/// The distance from the eye to the nearest surface, in world units.
///
/// The distance to the bounding sphere cannot replace it: the sphere may reach far behind the
/// visible surface. If the eye is inside the solid, the result is the distance to the centre of the
/// bounds.
fn surface_distance(file: &SceneFile) -> Result<f64, InputError> {
    let eye = file.camera.eye;
    let mut nearest = [0.0];
    file.field::<f64>()?.value(&[eye], &mut nearest);
    Ok(if nearest[0] > 0.0 { nearest[0] } else { (eye - file.bounds.center).length() })
}

/// Renders a scene in its own bounds. Returns the image and the number of field evaluations.
fn image<R: EstimatorPrecision + ScenePrecision>(
    file: &SceneFile,
    tracing: trace::Options<R>,
    spp: u32,
    seed: u64,
) -> anyhow::Result<(Film, Evaluations)> {
    let field = Counted::new(file.field::<R>()?);
    let shader = file.shader::<R>(&field)?;
    let cameras = [file.camera];
    let background = file.background::<R>()?;
    let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, &*background);
    let image = render(
        &scene.with_options(tracing).with_slope_of_field(SLOPE_POINTS),
        0,
        spp,
        seed,
        &|_| {},
    )?;
    Ok((image.film, field.evaluations()))
}
