//! Derivative images: one per `--wrt`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use estimate::gradient::{Derivative, Direction, differentiate};
use estimate::{Estimator, EstimatorPrecision};
use field::Evaluations;
use files::InputError;
use film::write_image;
use render::Scene;
use scene::{SceneFile, Sdf};

use super::options::Gradient;
use super::report::GradientReport;

impl Gradient {
    /// Computes the derivative images by an estimator and writes them.
    ///
    /// The caller completes the report: it counts the field evaluations, and asks the estimator for
    /// the terms that it leaves out.
    pub(super) fn derivative_images<R: EstimatorPrecision>(
        &self,
        file: &SceneFile,
        scene: &Scene<'_, R>,
        estimator: &dyn Estimator<R>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<GradientReport> {
        let directions = self.directions(file)?;
        let start = Instant::now();
        let derivatives = differentiate(scene, &directions, estimator, self.sampling(), progress)
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?;
        self.write_images(&derivatives, start.elapsed().as_secs_f64())
    }

    /// The parameters that the JSON pointers of `--wrt` name.
    pub(super) fn directions(&self, file: &SceneFile) -> Result<Vec<Direction>, InputError> {
        let named = |wrt: &String| {
            direction(file, wrt).ok_or_else(|| {
                let expected = "a JSON pointer to a number under /sdf, /appearance or /background";
                InputError::new(&self.scene, wrt, "no such number", expected)
            })
        };
        self.wrt.iter().map(named).collect()
    }

    /// The files to write: one, or one for each of several `--wrt`.
    pub(super) fn outputs(&self) -> Vec<PathBuf> {
        match self.wrt.as_slice() {
            [] | [_] => vec![self.output.clone()],
            several => several.iter().map(|wrt| suffixed(&self.output, wrt)).collect(),
        }
    }

    /// Writes the derivative image of each `--wrt`.
    ///
    /// # Errors
    /// If a derivative is not finite in single precision, or a file cannot be written.
    pub(super) fn write_images(
        &self,
        derivatives: &[Derivative],
        seconds: f64,
    ) -> anyhow::Result<GradientReport> {
        let outputs = self.outputs();
        for ((derivative, wrt), path) in derivatives.iter().zip(&self.wrt).zip(&outputs) {
            self.check_finite(derivative, wrt)?;
            write_image(path, &derivative.film)?;
        }
        let standard_error = derivatives
            .iter()
            .map(|d| d.standard_error)
            .try_fold(0.0, |worst, e| e.map(|e| e.max(worst)));
        let evaluations = Evaluations::default();
        let unmodelled = Vec::new();
        Ok(GradientReport {
            seconds,
            evaluations,
            standard_error,
            unmodelled,
            notes: Vec::new(),
            outputs,
            loss: None,
        })
    }

    fn check_finite(&self, derivative: &Derivative, wrt: &str) -> Result<(), InputError> {
        let Some((x, y)) = derivative.film.first_non_finite() else { return Ok(()) };
        let value = derivative.film.at(x, y);
        let found = format!("a derivative of {value:?} in pixel ({x}, {y})");
        Err(InputError::new(&self.scene, wrt, found, "a number in the range of single precision"))
    }
}

/// The parameter that a JSON pointer names; `None` if there is none.
fn direction(file: &SceneFile, wrt: &str) -> Option<Direction> {
    let (field, shader) = (file.sdf.pointers(), &file.appearance.pointers);
    if let Some(index) = field.iter().position(|p| p.as_deref() == Some(wrt)) {
        return Some(Direction::Field(index));
    }
    if let Some(index) = shader.iter().position(|p| p == wrt) {
        return Some(Direction::Shader(index));
    }
    if let (Sdf::Neural { .. }, Some(number)) = (&file.sdf, wrt.strip_prefix("/sdf/weights/"))
        && let Ok(number) = number.parse()
    {
        return Some(Direction::Along(number));
    }
    let background = file.background.pointers();
    background.iter().position(|p| p == wrt).map(Direction::Background)
}

/// The output file of one of several JSON pointers: `g.npy` for `/sdf/center/0` becomes
/// `g.sdf_center_0.npy`.
fn suffixed(output: &Path, pointer: &str) -> PathBuf {
    let suffix = pointer.trim_start_matches('/').replace('/', "_");
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    output.with_extension(format!("{suffix}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pointer_becomes_a_suffix_of_the_output() {
        assert_eq!(
            suffixed(Path::new("a/g.npy"), "/sdf/center/0"),
            PathBuf::from("a/g.sdf_center_0.npy")
        );
    }
}
