//! Derivative images by finite differences of rendered images.

use std::cell::RefCell;
use std::time::Instant;

use anyhow::Context;
use estimate::{EstimatorPrecision, finite_difference};
use field::{Counted, Evaluations, Field};
use film::Film;
use io::InputError;
use render::{Scene, render};
use scene::SceneFile;
use serde_json::Value;

use super::{Gradient, Report};
use crate::cli::common::color;

/// How far a number of the field moves the surface, in pixels.
const STEP_PIXELS: f64 = 0.05;

/// The step of any other number.
const STEP: f64 = 1e-2;

/// A number that needs a step smaller than 2^-STEP_HALVINGS of the usual one has no room for one.
const STEP_HALVINGS: i32 = 20;

impl Gradient {
    /// Central differences of the image of the scene file with one number changed.
    pub(super) fn differences<R: EstimatorPrecision>(
        &self,
        file: &SceneFile,
        tracing: trace::Options<R>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<Report> {
        // The pointers are checked as for any estimator.
        self.directions(file)?;
        let start = Instant::now();
        let text = std::fs::read_to_string(&self.scene)
            .with_context(|| self.scene.display().to_string())?;
        let value: Value = serde_json::from_str(&text)?;
        let pixel = file.camera.pixel_angle() * surface_distance(file)?;
        let evaluations = RefCell::new(Evaluations::default());
        let mut derivatives = Vec::new();
        for (done, wrt) in self.wrt.iter().enumerate() {
            let share = |fraction: f64| progress((done as f64 + fraction) / self.wrt.len() as f64);
            let step = if wrt.starts_with("/sdf/") { STEP_PIXELS * pixel } else { STEP };
            let step = self.step_with_room(&value, wrt, step)?;
            derivatives.push(finite_difference(self.sampling(), step, &share, |offset, part| {
                let moved = self.moved(&value, wrt, offset)?;
                let (film, used) = image::<R>(&moved, tracing, part.counts.spp, part.seed)
                    .map_err(|e| self.not_finite(e))?;
                *evaluations.borrow_mut() += used;
                anyhow::Ok(film)
            })?);
        }
        let report = self.write_images(&derivatives, start.elapsed().as_secs_f64())?;
        Ok(Report { evaluations: evaluations.into_inner(), ..report })
    }

    /// The scene with `offset` added to the number at `wrt`.
    fn moved(&self, value: &Value, wrt: &str, offset: f64) -> Result<SceneFile, InputError> {
        let mut value = value.clone();
        if let Some(number) = value.pointer_mut(wrt) {
            *number = (number.as_f64().unwrap_or_default() + offset).into();
        }
        SceneFile::from_value(&self.scene, &value)
    }

    /// `step`, halved until the scene is valid on both sides: a small radius has room for a small
    /// step only.
    fn step_with_room(&self, value: &Value, wrt: &str, step: f64) -> Result<f64, InputError> {
        let mut steps = (0..STEP_HALVINGS).map(|i| step * 0.5f64.powi(i));
        let valid = |step: f64| {
            self.moved(value, wrt, step).is_ok() && self.moved(value, wrt, -step).is_ok()
        };
        steps.find(|step| valid(*step)).ok_or_else(|| {
            let found = value.pointer(wrt).map_or_else(String::new, ToString::to_string);
            let expected = "a number with room on both sides, for finite differences";
            InputError::new(&self.scene, wrt, found, expected)
        })
    }

    fn not_finite(&self, error: anyhow::Error) -> anyhow::Error {
        match error.downcast::<render::InvalidField>() {
            Ok(e) => InputError::new(&self.scene, "/sdf", e, "a finite field").into(),
            Err(error) => error,
        }
    }
}

/// The distance from the eye to the nearest surface. The bounding sphere would not do: it may reach
/// far behind the visible surface.
fn surface_distance(file: &SceneFile) -> Result<f64, InputError> {
    let eye = file.camera.eye;
    let mut nearest = [0.0];
    file.sdf.build::<f64>()?.value(&[eye], &mut nearest);
    Ok(if nearest[0] > 0.0 { nearest[0] } else { (eye - file.bounds.center).length() })
}

/// The image of a scene, in its own bounds, with the field evaluations that it took.
fn image<R: EstimatorPrecision>(
    file: &SceneFile,
    tracing: trace::Options<R>,
    spp: u32,
    seed: u64,
) -> anyhow::Result<(Film, Evaluations)> {
    let field = Counted::new(file.sdf.build::<R>()?);
    let shader = file.shader::<R>(&field)?;
    let cameras = [file.camera];
    let background = color::<R>(file.background);
    let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, background);
    let image = render(&scene.with_options(tracing), 0, spp, seed, &|_| {})?;
    Ok((image.film, field.evaluations()))
}
