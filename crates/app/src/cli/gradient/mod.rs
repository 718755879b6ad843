//! `dsdf gradient`.

mod differences;
mod images;
mod method;
mod options;
mod report;
mod target;

use estimate::{Discontinuity, EstimatorPrecision};
use field::{Counted, SLOPE_POINTS};
use files::InputError;
use render::Scene;
use scene::{Appearance, SceneFile, ScenePrecision};

use super::common::{Global, PrecisionArg, check_film};
use method::Method;
use report::GradientReport;

pub(super) use method::{FD_HELP, FINITE_DIFFERENCES};
pub(crate) use options::Gradient;

/// Bytes of memory for each pixel of the film. Measured: 24, and 48 for finite differences.
const BYTES: u64 = 72;

/// Bytes of memory for each pixel of a derivative image. Measured: 26.
const BYTES_OF_DERIVATIVE: u64 = 32;

impl GradientReport {
    fn text(&self) -> String {
        let error =
            self.standard_error.map_or("unknown".to_owned(), |e| format!("{:.3} %", 100.0 * e));
        format!("{:.3} s, standard error {error} (relative L2)", self.seconds)
    }
}

impl Gradient {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let report = match self.precision {
            PrecisionArg::F32 => self.compute::<f32>(global)?,
            PrecisionArg::F64 => self.compute::<f64>(global)?,
        };
        if !report.unmodelled.is_empty() {
            let left_out = report.unmodelled.join(" and ");
            global.say(&format!("WARNING the estimator leaves out {left_out}"));
        }
        report.notes.iter().for_each(|note| global.say(&format!("WARNING {note}")));
        global.report(&report, || report.text())
    }

    /// Checks all arguments, computes the derivatives and writes them.
    fn compute<R: EstimatorPrecision + ScenePrecision>(
        &self,
        global: &Global,
    ) -> anyhow::Result<GradientReport> {
        let method = self.method(&global.registry)?;
        self.validate_warp()?;
        let tracing = self.trace_options()?;
        let outputs = self.outputs();
        outputs.iter().try_for_each(|path| global.will_write(path, self.extensions()))?;
        let file = self.load()?;
        let (size, images) = ([file.camera.width, file.camera.height], self.wrt.len() as u64);
        let bytes = BYTES + BYTES_OF_DERIVATIVE * images;
        check_film(&self.scene, "/camera", size, 1, bytes)?;
        let field = Counted::new(file.field::<R>()?);
        let shader = file.shader::<R>(&field)?;
        let cameras = [file.camera];
        let background = file.background::<R>()?;
        let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, &*background);
        let scene = scene.with_options(tracing).with_slope_of_field(SLOPE_POINTS);
        let bar = global.progress("gradient");
        let progress = bar.mover();
        let mut report = match method {
            Method::Estimator(entry) => {
                let estimator = entry.estimator::<R>(&self.estimator_options());
                let report = match &self.target {
                    Some(target) => {
                        self.target_gradient(&file, &scene, target, &*estimator, &progress)?
                    }
                    None => self.derivative_images(&file, &scene, &*estimator, &progress)?,
                };
                let unmodelled = estimator.unmodelled(&scene);
                GradientReport {
                    unmodelled: unmodelled.into_iter().map(Discontinuity::name).collect(),
                    ..report
                }
            }
            Method::FiniteDifferences => self.differences::<R>(&file, tracing, &progress)?,
        };
        report.evaluations += field.evaluations();
        bar.finish_and_clear();
        Ok(report)
    }

    /// Loads the scene file.
    ///
    /// # Errors
    /// If the file is wrong, or the scene has shadows: no estimator differentiates their edges.
    fn load(&self) -> Result<SceneFile, InputError> {
        let file = SceneFile::load(&self.scene)?;
        if let Appearance::Lambert { shadows: true, .. } = file.appearance.appearance {
            let expected = "false: the edges of shadows are not differentiated";
            return Err(InputError::new(&self.scene, "/appearance/shadows", "true", expected));
        }
        Ok(file)
    }
}
