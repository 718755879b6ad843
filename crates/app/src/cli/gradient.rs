//! `dsdf gradient`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use field::{Counted, Evaluations};
use serde::Serialize;

use super::common::{Global, PrecisionArg, check_extension, color, mover};
use super::preset::Preset;
use estimate::{
    Derivative, Direction, Filter, Method, Sampling, Setup, differentiate, finite_difference,
    render, target_gradient,
};
use io::InputError;
use io::{read_image, write_image};
use render::Precision;
use scene::{Appearance, Scene, Sdf};

/// Differentiate a scene's image by one of its numbers, or the loss ½ Σ (I − target)² by a
/// network's weights.
#[derive(Args, Debug)]
pub(crate) struct Gradient {
    /// The scene file
    scene: PathBuf,
    /// JSON pointer of a number in the scene, for example /sdf/radius; may repeat. Of a neural
    /// scene, /sdf/weights/N is the Nth random direction of unit length in the space of its weights
    #[arg(long, required_unless_present = "target", conflicts_with = "target")]
    wrt: Vec<String>,
    /// Target image of the loss, for the gradient by all weights of a neural scene
    #[arg(long)]
    target: Option<PathBuf>,
    /// Where to write: .npy or .exr for --wrt, .safetensors for --target
    #[arg(short, long)]
    output: PathBuf,
    /// The estimator: refined, paper, paper-all, interior, gaussian, was, loubet, band, contour or
    /// fd [default: refined, or gaussian with --filter gaussian]
    #[arg(long)]
    estimator: Option<String>,
    /// How much to spend where no option says otherwise
    #[arg(long, value_enum)]
    #[allow(dead_code, reason = "put into the other options before they are read")]
    preset: Option<Preset>,
    /// Samples a pixel
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Samples on each edge between pixels; with refined, lines along each axis of a pixel
    /// [default: half of --spp]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65536))]
    edge_samples: Option<u32>,
    /// N: points of the quadrature along a ray; like the four below of the warps alone (paper,
    /// paper-all, gaussian)
    #[arg(long, default_value_t = 22, value_parser = clap::value_parser!(u32).range(1..=65536))]
    steps: u32,
    /// k: points that keep a weight
    #[arg(long, default_value_t = 14)]
    top_k: usize,
    /// γ: exponent of the weights
    #[arg(long, default_value_t = 3.0)]
    gamma: f64,
    /// λ_d: weight of |∇f·d| beside |f|
    #[arg(long, default_value_t = 1.0)]
    lambda_d: f64,
    /// ε: guard inside the weights, in world units
    #[arg(long, default_value_t = 1e-6)]
    epsilon: f64,
    /// ρ: the fraction of f that a step of the tracer, and of the warps' recursion, takes; below 1
    /// for fields steeper than a distance
    #[arg(long, default_value_t = 1.0)]
    relaxation: f64,
    /// |f| at which a hit is good enough, in bounding radii (or widths of the film there, if these are less) [default: 16 units in
    /// the last place]
    #[arg(long)]
    hit_tolerance: Option<f64>,
    /// Pixel filter, box or gaussian [default: the estimator's]
    #[arg(long)]
    filter: Option<String>,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Precision of the computation
    #[arg(long, value_enum, default_value = "f64")]
    precision: PrecisionArg,
}

#[derive(Serialize)]
struct Report {
    seconds: f64,
    evaluations: Evaluations,
    /// Relative L2, estimated from independent replicates; of the worst of several derivatives.
    standard_error: Option<f64>,
    outputs: Vec<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    loss: Option<f64>,
}

/// How far finite differences move a surface, in pixels, and other numbers.
const STEP_PIXELS: f64 = 0.05;
const STEP: f64 = 1e-2;

/// How often a step is halved before a number counts as one without room.
const STEP_HALVINGS: i32 = 20;

/// What the messages about flags name as their file.
const ARGUMENTS: &str = "arguments";

impl Gradient {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        match self.precision {
            PrecisionArg::F32 => self.run_in::<f32>(global),
            PrecisionArg::F64 => self.run_in::<f64>(global),
        }
    }

    fn run_in<R: Precision>(&self, global: &Global) -> anyhow::Result<()> {
        let sampling = self.sampling()?;
        global.check_estimator(sampling.method)?;
        let weights = self.wrt.iter().any(|wrt| wrt.starts_with("/sdf/weights/"));
        if sampling.method == Method::FiniteDifferences && (self.target.is_some() || weights) {
            let expected = "another one for weights: contour is the reference there";
            return Err(InputError::new(ARGUMENTS, "--estimator", "fd", expected).into());
        }
        match &self.target {
            Some(target) => {
                check_extension(&self.output, &["safetensors"]).map(|()| Some(target))?
            }
            None => check_extension(&self.output, &["npy", "exr"]).map(|()| None)?,
        };
        let scene = Scene::load(&self.scene)?;
        if let Appearance::Lambert { shadows: true, .. } = scene.appearance.appearance {
            let expected = "false: the edges of shadows are not differentiated";
            return Err(
                InputError::new(&self.scene, "/appearance/shadows", "true", expected).into()
            );
        }
        let field = Counted::new(scene.sdf.build::<R>()?);
        let shader = scene.shader::<R>(&field)?;
        let cameras = [scene.camera];
        let mut setup =
            Setup::new(&field, &*shader, &cameras, &scene.bounds, color::<R>(scene.background));
        setup.steps = self.steps as usize;
        setup.trace = self.trace_options()?;
        setup.warp = self.warp_options()?;
        setup.weighting =
            global.weights.as_ref().and_then(super::Weights::get::<R>).map(|w| w as _);
        let bar = global.progress("gradient");
        let start = Instant::now();
        let invalid = |e| InputError::new(&self.scene, "/sdf", e, "a finite field");
        let mut evaluations = Evaluations::default();
        let mut report = if let Some(path) = &self.target {
            self.with_target(&scene, &setup, path, sampling, &mover(&bar))?
        } else {
            let directions = self.directions(&scene)?;
            let derivatives = if sampling.method == Method::FiniteDifferences {
                self.differences::<R>(&scene, sampling, &mover(&bar), &mut evaluations)?
            } else {
                differentiate(&setup, &directions, sampling, &mover(&bar)).map_err(invalid)?
            };
            self.write_images(&derivatives, start.elapsed().as_secs_f64())?
        };
        evaluations += field.evaluations();
        report.evaluations = evaluations;
        bar.finish_and_clear();
        global.report(&report, || {
            let error = report
                .standard_error
                .map_or("unknown".to_owned(), |e| format!("{:.3} %", 100.0 * e));
            format!("{:.3} s, standard error {error} (relative L2)", report.seconds)
        })
    }

    fn sampling(&self) -> Result<Sampling, InputError> {
        let gaussian = match self.filter.as_deref() {
            None | Some("box") => false,
            Some("gaussian") => true,
            Some(other) => {
                return Err(InputError::new(ARGUMENTS, "--filter", other, "box or gaussian"));
            }
        };
        let name =
            self.estimator.as_deref().unwrap_or(if gaussian { "gaussian" } else { "refined" });
        let method = name.parse::<Method>();
        let mut method = method.map_err(|e| InputError::new(ARGUMENTS, "--estimator", name, e))?;
        if gaussian && method == Method::Paper {
            method = Method::Gaussian;
        }
        if self.filter.is_some() && gaussian != (method.filter() == Filter::Gaussian) {
            let own = if gaussian { "box" } else { "gaussian" };
            let found = self.filter.as_deref().unwrap_or_default();
            let expected = format!("{own}, the filter of --estimator {name}");
            return Err(InputError::new(ARGUMENTS, "--filter", found, expected));
        }
        let edge_samples = self.edge_samples.unwrap_or_else(|| self.spp.div_ceil(2));
        Ok(Sampling { method, spp: self.spp, edge_samples, seed: self.seed })
    }

    fn warp_options<R: Precision>(&self) -> Result<warp::Options<R>, InputError> {
        let constant = <R as field::Real>::of;
        let options = warp::Options {
            k: self.top_k,
            gamma: constant(self.gamma),
            lambda_d: constant(self.lambda_d),
            epsilon: constant(self.epsilon),
            relaxation: constant(self.relaxation),
        };
        let refused = |e: warp::InvalidOptions| {
            InputError::new(
                ARGUMENTS,
                format!("--{}", e.name.replace('_', "-")),
                e.found,
                e.expected,
            )
        };
        options.validate().map_err(refused)?;
        Ok(options)
    }

    fn trace_options<R: Precision>(&self) -> Result<trace::Options<R>, InputError> {
        let constant = <R as field::Real>::of;
        let default = trace::Options::<R>::default();
        let tolerance = self.hit_tolerance.map_or(default.tolerance, constant);
        let options =
            trace::Options { relaxation: constant(self.relaxation), tolerance, ..default };
        let flag = |name: &str| {
            if name == "tolerance" { "--hit-tolerance".to_owned() } else { format!("--{name}") }
        };
        let refused = |e: trace::InvalidOptions| {
            InputError::new(ARGUMENTS, flag(e.name), e.found, e.expected)
        };
        options.validate().map_err(refused).map(|()| options)
    }

    /// The parameter that each --wrt names.
    fn directions(&self, scene: &Scene) -> Result<Vec<Direction>, InputError> {
        let (field, shader) = (scene.sdf.pointers(), &scene.appearance.pointers);
        let named = |wrt: &String| {
            if let Some(index) = field.iter().position(|p| p.as_deref() == Some(wrt)) {
                return Ok(Direction::Field(index));
            }
            if let Some(index) = shader.iter().position(|p| p == wrt) {
                return Ok(Direction::Shader(index));
            }
            if let (Sdf::Neural { .. }, Some(number)) =
                (&scene.sdf, wrt.strip_prefix("/sdf/weights/"))
                && let Ok(number) = number.parse()
            {
                return Ok(Direction::Along(number));
            }
            match wrt.strip_prefix("/background/").and_then(|c| c.parse().ok()) {
                Some(channel @ 0..3) => Ok(Direction::Background(channel)),
                _ => Err(InputError::new(
                    &self.scene,
                    wrt,
                    "no such number",
                    "a JSON pointer to a number under /sdf, /appearance or /background",
                )),
            }
        };
        self.wrt.iter().map(named).collect()
    }

    /// Finite differences: the scene file with one number changed, rendered.
    fn differences<R: Precision>(
        &self,
        scene: &Scene,
        sampling: Sampling,
        progress: &(dyn Fn(f64) + Sync),
        evaluations: &mut Evaluations,
    ) -> anyhow::Result<Vec<Derivative>> {
        let text = std::fs::read_to_string(&self.scene)?;
        let value: serde_json::Value = serde_json::from_str(&text)?;
        let camera = &scene.camera;
        // At the nearest surface: the bounds may reach far behind what is seen.
        let mut nearest = [0.0];
        scene.sdf.build::<f64>()?.value(&[camera.eye], &mut nearest);
        let away =
            if nearest[0] > 0.0 { nearest[0] } else { (camera.eye - scene.bounds.center).length() };
        let pixel = camera.pixel_angle() * away;
        let trace = self.trace_options()?;
        let (mut derivatives, counted) = (Vec::new(), std::cell::RefCell::new(evaluations));
        for (done, wrt) in self.wrt.iter().enumerate() {
            let step = if wrt.starts_with("/sdf/") { STEP_PIXELS * pixel } else { STEP };
            let share = |fraction: f64| progress((done as f64 + fraction) / self.wrt.len() as f64);
            let moved = |offset: f64| {
                let mut value = value.clone();
                if let Some(number) = value.pointer_mut(wrt) {
                    *number = (number.as_f64().unwrap_or_default() + offset).into();
                }
                Scene::from_value(&self.scene, &value)
            };
            // A small number has room for a small step only.
            let mut steps = (0..STEP_HALVINGS).map(|i| step * 0.5f64.powi(i));
            let step = steps.find(|step| moved(*step).is_ok() && moved(-step).is_ok()).ok_or_else(
                || {
                    let found = value.pointer(wrt).map_or_else(String::new, ToString::to_string);
                    InputError::new(
                        &self.scene,
                        wrt,
                        found,
                        "a number with room on both sides, for finite differences",
                    )
                },
            )?;
            derivatives.push(finite_difference(sampling, step, &share, |offset, part| {
                let moved = moved(offset)?;
                let field = Counted::new(moved.sdf.build::<R>()?);
                let shader = moved.shader::<R>(&field)?;
                let cameras = [moved.camera];
                let mut setup = Setup::new(
                    &field,
                    &*shader,
                    &cameras,
                    &moved.bounds,
                    color::<R>(moved.background),
                );
                setup.trace = trace;
                let image = render(&setup, 0, part.spp, part.seed, &|_| {});
                **counted.borrow_mut() += field.evaluations();
                anyhow::Ok(
                    image
                        .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?
                        .film,
                )
            })?);
        }
        Ok(derivatives)
    }

    fn write_images(&self, derivatives: &[Derivative], seconds: f64) -> anyhow::Result<Report> {
        let mut outputs = Vec::new();
        for (derivative, wrt) in derivatives.iter().zip(&self.wrt) {
            if let Some((x, y)) = derivative.film.first_non_finite() {
                let found =
                    format!("a derivative of {:?} in pixel ({x}, {y})", derivative.film.at(x, y));
                return Err(InputError::new(
                    &self.scene,
                    wrt,
                    found,
                    "one within single precision",
                )
                .into());
            }
            let path =
                if self.wrt.len() == 1 { self.output.clone() } else { suffixed(&self.output, wrt) };
            write_image(&path, &derivative.film)?;
            outputs.push(path);
        }
        let standard_error = derivatives
            .iter()
            .map(|d| d.standard_error)
            .try_fold(0.0, |worst, e| e.map(|e| e.max(worst)));
        Ok(Report {
            seconds,
            evaluations: Evaluations::default().into(),
            standard_error,
            outputs,
            loss: None,
        })
    }

    fn with_target<R: Precision>(
        &self,
        scene: &Scene,
        setup: &Setup<'_, R>,
        path: &Path,
        sampling: Sampling,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<Report> {
        let Sdf::Neural { path: model, bytes } = &scene.sdf else {
            return Err(InputError::new(
                &self.scene,
                "/sdf/type",
                "an analytic shape",
                "neural, for --target",
            )
            .into());
        };
        let (target, _) = read_image(path)?;
        if let Some((x, y)) = target.first_non_finite() {
            let found = format!("{:?}", target.at(x, y));
            return Err(InputError::new(
                path,
                format!("pixel ({x}, {y})"),
                found,
                "finite numbers",
            )
            .into());
        }
        let size = (scene.camera.width, scene.camera.height);
        if (target.width, target.height) != size {
            let found = format!("{} x {} pixels", target.width, target.height);
            return Err(InputError::new(
                path,
                "size",
                found,
                format!("{} x {}, as the camera", size.0, size.1),
            )
            .into());
        }
        let start = Instant::now();
        let gradient = target_gradient(setup, &target, sampling, progress)
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?;
        let seconds = start.elapsed().as_secs_f64();
        let mut network = scene::network::<R>(model, bytes)?;
        network.set_parameters(&gradient.parameters);
        let bytes = network.to_safetensors()?;
        io::atomic_write(&self.output, |out| Ok(out.write_all(&bytes)?))?;
        Ok(Report {
            seconds,
            evaluations: Evaluations::default().into(),
            standard_error: gradient.standard_error,
            outputs: vec![self.output.clone()],
            loss: Some(gradient.loss),
        })
    }
}

/// `g.npy` for `/sdf/center/0`: `g.sdf_center_0.npy`.
fn suffixed(output: &Path, pointer: &str) -> PathBuf {
    let suffix = pointer.trim_start_matches('/').replace('/', "_");
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    output.with_extension(format!("{suffix}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_names_take_the_pointer() {
        assert_eq!(
            suffixed(Path::new("a/g.npy"), "/sdf/center/0"),
            PathBuf::from("a/g.sdf_center_0.npy")
        );
    }
}
