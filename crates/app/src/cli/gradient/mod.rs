//! `dsdf gradient`.

mod differences;
mod target;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{ArgMatches, Args};
use estimate::{
    Derivative, Direction, Entry, EstimatorOptions, EstimatorPrecision, Filter, SampleCounts,
    Sampling, differentiate,
};
use field::{Counted, Evaluations, Real};
use io::{InputError, write_image};
use render::Scene;
use scene::{Appearance, SceneFile, Sdf};
use serde::Serialize;
use warp::WarpOptions;

use super::common::{ARGUMENTS, Global, PrecisionArg, check_extension, color, mover, option_error};
use super::preset::{Preset, is_explicit};

/// Differentiate a scene's image by one of its numbers, or the loss ½ Σ (I − target)² by a
/// network's weights.
#[derive(Args, Debug)]
pub(crate) struct Gradient {
    /// The scene file
    scene: PathBuf,
    /// JSON pointer of a number in the scene, for example /sdf/radius; may repeat. In a neural
    /// scene, /sdf/weights/N is the Nth random direction of unit length in the space of its weights
    #[arg(long, required_unless_present = "target", conflicts_with = "target")]
    wrt: Vec<String>,
    /// Target image of the loss, for the gradient by all weights of a neural scene
    #[arg(long)]
    target: Option<PathBuf>,
    /// Where to write: .npy or .exr for --wrt, .safetensors for --target
    #[arg(short, long)]
    output: PathBuf,
    /// The estimator [default: refined, or gaussian with --filter gaussian]
    #[arg(long)]
    estimator: Option<String>,
    /// Speed/accuracy preset; explicit options override it
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    /// Samples a pixel
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Samples on each edge between pixels; with refined, lines along each axis of a pixel
    /// [default: half of --spp]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65536))]
    edge_samples: Option<u32>,
    #[command(flatten)]
    warp: WarpOptions,
    /// ρ: fraction of f that a step of the tracer and of the warps' recursion takes; below 1 for
    /// fields steeper than a distance
    #[arg(long, default_value_t = 1.0)]
    relaxation: f64,
    /// |f| that counts as a hit, in bounding radii, or in widths of the film at the surface if those
    /// are less [default: 16 units in the last place]
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

/// The name of finite differences on the command line. They render changed scenes, so they are no
/// estimator of the registry.
const FINITE_DIFFERENCES: &str = "fd";

/// The line of finite differences in `--help`.
pub(super) const FD_HELP: &str = "\n- fd: ground truth: central differences, for --wrt alone";

#[derive(Serialize)]
struct Report {
    seconds: f64,
    evaluations: Evaluations,
    /// Relative L2, estimated from independent replicates; the largest of several derivatives.
    standard_error: Option<f64>,
    outputs: Vec<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    loss: Option<f64>,
}

/// How the derivative is computed.
enum Method<'a> {
    Estimator(&'a Entry),
    FiniteDifferences,
}

impl Gradient {
    /// Replaces the defaults of options that are not on the command line by the preset's values.
    pub(super) fn resolve_preset(&mut self, matches: &ArgMatches) {
        let spp = match self.preset {
            Some(Preset::Fast) => 16,
            Some(Preset::Accurate) => 1024,
            Some(Preset::Balanced) | None => return,
        };
        if !is_explicit(matches, "spp") {
            self.spp = spp;
        }
    }

    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        match self.precision {
            PrecisionArg::F32 => self.run_in::<f32>(global),
            PrecisionArg::F64 => self.run_in::<f64>(global),
        }
    }

    fn run_in<R: EstimatorPrecision>(&self, global: &Global) -> anyhow::Result<()> {
        let method = self.method(global)?;
        self.warp.validate().map_err(|e| option_error(e.name, e.found, e.expected))?;
        let tracing = self.trace_options()?;
        let extensions: &[&str] =
            if self.target.is_some() { &["safetensors"] } else { &["npy", "exr"] };
        check_extension(&self.output, extensions)?;
        let file = self.load()?;
        let field = Counted::new(file.sdf.build::<R>()?);
        let shader = file.shader::<R>(&field)?;
        let cameras = [file.camera];
        let background = color::<R>(file.background);
        let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, background);
        let scene = scene.with_options(tracing);
        let bar = global.progress("gradient");
        let report = match (&method, &self.target) {
            (Method::Estimator(entry), Some(target)) => {
                self.target_gradient(&file, &scene, target, entry, &mover(&bar))?
            }
            (Method::Estimator(entry), None) => {
                self.derivative_images(&file, &scene, entry, &mover(&bar))?
            }
            (Method::FiniteDifferences, _) => {
                self.differences::<R>(&file, tracing, &mover(&bar))?
            }
        };
        let mut evaluations = report.evaluations;
        evaluations += field.evaluations();
        let report = Report { evaluations, ..report };
        bar.finish_and_clear();
        global.report(&report, || {
            let error = report
                .standard_error
                .map_or("unknown".to_owned(), |e| format!("{:.3} %", 100.0 * e));
            format!("{:.3} s, standard error {error} (relative L2)", report.seconds)
        })
    }

    /// The scene, if it can be differentiated.
    fn load(&self) -> Result<SceneFile, InputError> {
        let file = SceneFile::load(&self.scene)?;
        if let Appearance::Lambert { shadows: true, .. } = file.appearance.appearance {
            let expected = "false: the edges of shadows are not differentiated";
            return Err(InputError::new(&self.scene, "/appearance/shadows", "true", expected));
        }
        Ok(file)
    }

    /// The method that --estimator and --filter name.
    fn method<'a>(&self, global: &'a Global) -> Result<Method<'a>, InputError> {
        let gaussian = match self.filter.as_deref() {
            None | Some("box") => false,
            Some("gaussian") => true,
            Some(other) => {
                return Err(InputError::new(ARGUMENTS, "--filter", other, "box or gaussian"));
            }
        };
        let name = match self.estimator.as_deref() {
            None | Some("paper") if gaussian => "gaussian",
            None => "refined",
            Some(name) => name,
        };
        let entry = global.registry.get(name);
        let filter = entry.map_or(Filter::Box, Entry::filter);
        let method = match entry {
            Some(entry) => Method::Estimator(entry),
            None if name == FINITE_DIFFERENCES => Method::FiniteDifferences,
            None => {
                let names = global.registry.names();
                let expected = format!("one of {names}, {FINITE_DIFFERENCES}");
                return Err(InputError::new(ARGUMENTS, "--estimator", name, expected));
            }
        };
        if let Some(found) =
            self.filter.as_deref().filter(|_| gaussian != (filter == Filter::Gaussian))
        {
            let own = if gaussian { "box" } else { "gaussian" };
            let expected = format!("{own}, the filter of --estimator {name}");
            return Err(InputError::new(ARGUMENTS, "--filter", found, expected));
        }
        let weights = self.wrt.iter().any(|wrt| wrt.starts_with("/sdf/weights/"));
        if entry.is_none() && (self.target.is_some() || weights) {
            let expected = "another one for weights: contour is the reference there";
            return Err(InputError::new(ARGUMENTS, "--estimator", name, expected));
        }
        Ok(method)
    }

    fn sampling(&self) -> Sampling {
        let edge_samples = self.edge_samples.unwrap_or_else(|| self.spp.div_ceil(2));
        Sampling { counts: SampleCounts { spp: self.spp, edge_samples }, seed: self.seed }
    }

    fn estimator_options(&self) -> EstimatorOptions {
        EstimatorOptions { warp: self.warp, ..EstimatorOptions::default() }
    }

    fn trace_options<R: Real>(&self) -> Result<trace::Options<R>, InputError> {
        let default = trace::Options::<R>::default();
        let tolerance = self.hit_tolerance.map_or(default.tolerance, R::of);
        let options = trace::Options { relaxation: R::of(self.relaxation), tolerance, ..default };
        let flag = |name| if name == "tolerance" { "hit_tolerance" } else { name };
        let refused = |e: trace::InvalidOptions| option_error(flag(e.name), e.found, e.expected);
        options.validate().map_err(refused).map(|()| options)
    }

    fn derivative_images<R: EstimatorPrecision>(
        &self,
        file: &SceneFile,
        scene: &Scene<'_, R>,
        entry: &Entry,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<Report> {
        let directions = self.directions(file)?;
        let estimator = entry.estimator::<R>(&self.estimator_options());
        let start = Instant::now();
        let derivatives = differentiate(scene, &directions, &*estimator, self.sampling(), progress)
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?;
        self.write_images(&derivatives, start.elapsed().as_secs_f64())
    }

    /// The parameter that each --wrt names.
    fn directions(&self, file: &SceneFile) -> Result<Vec<Direction>, InputError> {
        let (field, shader) = (file.sdf.pointers(), &file.appearance.pointers);
        let named = |wrt: &String| {
            if let Some(index) = field.iter().position(|p| p.as_deref() == Some(wrt)) {
                return Ok(Direction::Field(index));
            }
            if let Some(index) = shader.iter().position(|p| p == wrt) {
                return Ok(Direction::Shader(index));
            }
            if let (Sdf::Neural { .. }, Some(number)) =
                (&file.sdf, wrt.strip_prefix("/sdf/weights/"))
                && let Ok(number) = number.parse()
            {
                return Ok(Direction::Along(number));
            }
            match wrt.strip_prefix("/background/").and_then(|c| c.parse().ok()) {
                Some(channel @ 0..3) => Ok(Direction::Background(channel)),
                _ => {
                    let expected =
                        "a JSON pointer to a number under /sdf, /appearance or /background";
                    Err(InputError::new(&self.scene, wrt, "no such number", expected))
                }
            }
        };
        self.wrt.iter().map(named).collect()
    }

    /// Writes the derivative image of each --wrt.
    fn write_images(&self, derivatives: &[Derivative], seconds: f64) -> anyhow::Result<Report> {
        let mut outputs = Vec::new();
        for (derivative, wrt) in derivatives.iter().zip(&self.wrt) {
            if let Some((x, y)) = derivative.film.first_non_finite() {
                let value = derivative.film.at(x, y);
                let found = format!("a derivative of {value:?} in pixel ({x}, {y})");
                let expected = "one within single precision";
                return Err(InputError::new(&self.scene, wrt, found, expected).into());
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
        let evaluations = Evaluations::default();
        Ok(Report { seconds, evaluations, standard_error, outputs, loss: None })
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
