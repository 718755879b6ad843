//! The gradient of the loss ½ Σ (I − target)² by all weights of a neural scene.

use std::path::Path;
use std::time::Instant;

use estimate::gradient::target_gradient;
use estimate::{Estimator, EstimatorPrecision};
use field::Evaluations;
use files::{InputError, atomic_write};
use film::Film;
use film::read_image;
use render::Scene;
use scene::{SceneFile, ScenePrecision, Sdf};

use super::options::Gradient;
use super::report::GradientReport;

impl Gradient {
    /// Computes the gradient of the loss against the image `target`, and writes it as a model file:
    /// each weight is replaced by the derivative of the loss by it.
    ///
    /// The caller completes the report, as that of derivative images.
    pub(super) fn target_gradient<R: EstimatorPrecision + ScenePrecision>(
        &self,
        file: &SceneFile,
        scene: &Scene<'_, R>,
        target: &Path,
        estimator: &dyn Estimator<R>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<GradientReport> {
        let Sdf::Neural { path: model, bytes, .. } = &file.sdf else {
            let (found, expected) = ("an analytic shape", "neural, for --target");
            return Err(InputError::new(&self.scene, "/sdf/type", found, expected).into());
        };
        let target = read_target(target, file)?;
        let start = Instant::now();
        let gradient = target_gradient(scene, &target, estimator, self.sampling(), progress)
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?;
        let seconds = start.elapsed().as_secs_f64();
        let mut network = scene::network::<R>(model, bytes)?;
        network.set_parameters(&gradient.parameters);
        let bytes = network.to_safetensors()?;
        atomic_write(&self.output, |out| out.write_all(&bytes))?;
        Ok(GradientReport {
            seconds,
            evaluations: Evaluations::default(),
            standard_error: gradient.standard_error,
            unmodelled: Vec::new(),
            notes: Vec::new(),
            outputs: vec![self.output.clone()],
            loss: Some(gradient.loss),
        })
    }
}

/// Reads the target image.
///
/// # Errors
/// If the file cannot be read, a pixel is not finite, or the size is not that of the camera.
fn read_target(path: &Path, file: &SceneFile) -> anyhow::Result<Film> {
    let (target, _) = read_image(path)?;
    if let Some((x, y)) = target.first_non_finite() {
        let (field, found) = (format!("pixel ({x}, {y})"), format!("{:?}", target.at(x, y)));
        return Err(InputError::new(path, field, found, "finite numbers").into());
    }
    let (width, height) = (file.camera.width, file.camera.height);
    if (target.width, target.height) != (width, height) {
        let found = format!("{} x {} pixels", target.width, target.height);
        let expected = format!("{width} x {height}, the size of the camera's image");
        return Err(InputError::new(path, "size", found, expected).into());
    }
    Ok(target)
}
