//! The options of a fit. One struct gives the flags, the entries of `fit.toml` and their
//! documentation.

use std::path::Path;
use std::time::Duration;

use dataset::HeldOut;
use estimate::record::Pass;
use estimate::{Baseline, EstimatorOptions, Registry, SampleCounts};
use field::{Check, Sphere};
use files::{InputError, check_memory};
use glam::DVec3;
use multiview::calibrate::RefineCameras;
use multiview::stereo::StereoChoice;
use sdf_nn::grids::GridLevels;
use serde::{Deserialize, Serialize};
use warp::{WarpArgs, WarpDefaults, WarpOptions};

use crate::architecture::{encoding, is_fine, mlp_parameters, spline_size};
use loss::photometry::{BackgroundChoice, ExposureChoice, MaskChoice};

// The headings of the options in the help. `-h` shows the options of the first three alone.
const BUDGET: &str = "Budget";
const PHOTOGRAPHS: &str = "Photographs";
const CAMERAS: &str = "Cameras and bounds";
const SHAPE: &str = "Shape and schedule";
const ESTIMATOR: &str = "Estimator";
const FILES: &str = "Files of the run";

/// The options of `dsdf fit`. The `fit.toml` of a run records all of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct FitOptions {
    /// Number of iterations [default: 6000, without --time]
    #[arg(long, help_heading = BUDGET, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u64>,
    /// Wall time to spend, for example 90 (seconds), 10m or 1h30m; the schedule follows the clock
    #[arg(help_heading = BUDGET)]
    #[arg(long, conflicts_with = "iterations", value_parser = files::parse_duration)]
    #[serde(skip_serializing_if = "Option::is_none", with = "files::seconds")]
    pub time: Option<Duration>,
    /// The number of threads that the schedule of a fit by time assumes: the threads of its start.
    /// A resumed run keeps it, on any number of threads.
    #[arg(skip)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub schedule_threads: Option<usize>,
    /// Seed of all random numbers
    #[arg(long, help_heading = BUDGET, value_name = "N", default_value_t = Self::default().seed)]
    pub seed: u64,
    /// Read images at 1/N of their width and height [default: 1, or more if the images have more
    /// pixels than 8 million and than the budget can draw, or than 4 GiB of memory can hold]
    #[arg(long, help_heading = PHOTOGRAPHS, value_name = "N")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub downscale: Option<u32>,
    /// Photographs to hold out, to measure the fit on: a number, none, or auto: those that the data
    /// set holds out, or else every eighth of 20 and more
    #[arg(help_heading = PHOTOGRAPHS, hide_short_help = true)]
    #[arg(long, value_name = "N", default_value_t = Self::default().held_out)]
    #[serde(skip_serializing_if = "HeldOut::is_auto")]
    pub held_out: HeldOut,
    /// Use of masks and alpha channels
    #[arg(help_heading = PHOTOGRAPHS)]
    #[arg(long, value_name = "CHOICE", value_enum,
          default_value_t = Self::default().masks)]
    pub masks: MaskChoice,
    /// Model for the background
    #[arg(help_heading = PHOTOGRAPHS)]
    #[arg(long, value_name = "CHOICE", value_enum,
          default_value_t = Self::default().background)]
    pub background: BackgroundChoice,
    /// Refinement of the cameras: by keypoint matches before the fit, or by the loss once the
    /// surface is sharp
    #[arg(help_heading = CAMERAS)]
    #[arg(long, value_name = "CHOICE", value_enum,
          default_value_t = Self::default().refine_cameras)]
    pub refine_cameras: RefineCameras,
    /// Model for the exposures of the photographs
    #[arg(help_heading = PHOTOGRAPHS)]
    #[arg(long, value_name = "CHOICE", value_enum,
          default_value_t = Self::default().exposure)]
    pub exposure: ExposureChoice,
    /// Bounding sphere x,y,z,radius in world units, instead of the estimated one
    #[arg(help_heading = CAMERAS)]
    #[arg(long, value_parser = files::parse_bounds, allow_hyphen_values = true,
          value_name = "X,Y,Z,RADIUS")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 4]>,
    /// Width of the network's hidden layers
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().width)]
    pub width: usize,
    /// Number of the network's hidden layers
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().layers)]
    pub layers: usize,
    /// Octaves of the network's frequency encoding
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().bands)]
    pub bands: usize,
    /// Coefficients along a side of each level of the network's grid of splines: up to 4 rising
    /// numbers from 4 to 256, or none. Levels of 32 and less are everywhere from the start, others
    /// near the surface once it is sharp
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().grid)]
    pub grid: GridLevels,
    /// Sharpness β of the softplus ln(1 + exp(βx))/β, per unit of pre-activation
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().beta)]
    pub beta: f64,
    /// Radius of the initial sphere, as a fraction of the bounding radius
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().initial_radius)]
    pub initial_radius: f64,
    /// Largest learning rate of Adam [default: 0.003, or 0.002 in front of a trained background]
    #[arg(long, help_heading = SHAPE, hide_short_help = true)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub learning_rate: Option<f64>,
    /// Pixels per iteration, at full size and once the surface is sharp
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().batch)]
    pub batch: usize,
    /// Estimator of pixels that a silhouette may cross: see `dsdf gradient --estimator`
    #[arg(help_heading = ESTIMATOR, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().estimator)]
    pub estimator: String,
    /// Samples in each pixel that a silhouette may cross
    #[arg(help_heading = ESTIMATOR, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().edge_rays)]
    pub edge_rays: u32,
    /// Samples on each border edge of such a pixel; with refined, lines along each axis
    #[arg(help_heading = ESTIMATOR, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().edge_samples)]
    pub edge_samples: u32,
    /// Largest coefficient of f of one sample, in units of that of a silhouette across its whole
    /// pixel; inf for no limit
    #[arg(help_heading = ESTIMATOR, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().sample_limit)]
    pub sample_limit: f64,
    /// Constant that the warps subtract from the radiance of a pixel (a control variate)
    #[arg(help_heading = ESTIMATOR, hide_short_help = true)]
    #[arg(long, value_enum, default_value_t = Self::default().baseline)]
    pub baseline: Baseline,
    /// Largest norm of the gradient of an iteration, in units of its running mean; inf for no limit
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().clip)]
    pub clip: f64,
    /// The options of the published warp.
    #[command(flatten, next_help_heading = ESTIMATOR)]
    pub warp: WarpArgs<FitWarp>,
    /// Weight of the eikonal term (|∇f| − 1)²
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().eikonal)]
    pub eikonal: f64,
    /// Weight of the bending term: changes of ∇f along the surface, where the photographs are even;
    /// with levels of the grid above 32, it falls in the sharp part of long fits
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().bending)]
    pub bending: f64,
    /// Share of the budget, from its start, with a soft surface: parts of it can appear and vanish
    /// [default: 0.5, or down to 0.2 in long fits in front of a uniform background]
    #[arg(long, help_heading = SHAPE, hide_short_help = true)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub soft: Option<f64>,
    /// Depths of the photographs, by comparison with their neighbours: they guide the surface, and
    /// the fit removes surface that photographs contradict where no depth is known
    #[arg(help_heading = SHAPE, hide_short_help = true)]
    #[arg(long, value_enum, default_value_t = Self::default().stereo)]
    pub stereo: StereoChoice,
    /// Weight of the term of patches: photographs must agree about points of the sharp surface. It
    /// falls in the sharp part of long fits; 0 for none [default: 4, or 0 with refined distortion]
    #[arg(long, help_heading = SHAPE, hide_short_help = true)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub patches: Option<f64>,
    /// Iterations between checkpoints
    #[arg(help_heading = FILES, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().checkpoint_every)]
    pub checkpoint_every: u64,
    /// Iterations between preview pictures
    #[arg(help_heading = FILES, hide_short_help = true)]
    #[arg(long, default_value_t = Self::default().preview_every)]
    pub preview_every: u64,
}

/// The defaults of the warp of a fit: flags and entries of the `[warp]` table that are not given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitWarp;

impl WarpDefaults for FitWarp {
    const OPTIONS: WarpOptions = WarpOptions::FIT;
}

// The evidence for the two limits is in the module `loss::schedule`.

/// The default limit on the coefficient of f of one sample; see [`Pass::Limited`]. At 0.3 and 3:
/// distance 1.07 and 1.09.
const SAMPLE_LIMIT: f64 = 1.0;

/// The default of the norm to which the gradient of an iteration is clipped, as a multiple of its
/// running mean. At 1.5 and 10: distance 1.06 and 1.04.
///
/// Clipping by the norm: Pascanu, Mikolov and Bengio, "On the difficulty of training recurrent
/// neural networks", ICML 2013.
const CLIP: f64 = 3.0;

/// The default of the largest learning rate, in front of a trained background and of a plain one.
/// docs/detail.md compares rates.
const LEARNING_RATE: f64 = 2e-3;
const PLAIN_RATE: f64 = 3e-3;

/// The default weight of the term of patches. docs/captures-compared.md compares weights.
const PATCHES: f64 = 4.0;

/// The number of iterations without `--iterations` and without `--time`.
pub(crate) const DEFAULT_ITERATIONS: u64 = 6000;

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions {
            iterations: None,
            time: None,
            seed: 0,
            downscale: None,
            held_out: HeldOut::Auto,
            masks: MaskChoice::Auto,
            background: BackgroundChoice::Auto,
            refine_cameras: RefineCameras::Auto,
            exposure: ExposureChoice::Auto,
            bounds: None,
            width: 64,
            layers: 3,
            bands: 6,
            grid: GridLevels(vec![32, 64, 128]),
            beta: 100.0,
            initial_radius: 0.5,
            learning_rate: None,
            batch: 1024,
            estimator: "refined".to_owned(),
            edge_rays: 4,
            edge_samples: 1,
            sample_limit: SAMPLE_LIMIT,
            // It has a tenth of the variance of the background as baseline.
            baseline: Baseline::PixelMean,
            clip: CLIP,
            warp: WarpArgs::default(),
            eikonal: 0.1,
            bending: 0.1,
            schedule_threads: None,
            soft: None,
            stereo: StereoChoice::Auto,
            patches: None,
            checkpoint_every: 200,
            preview_every: 500,
        }
    }
}

/// The most pixels of an iteration: 2^24, the pixels of a photograph of 4096 × 4096.
const MAX_BATCH: usize = 1 << 24;

/// Bytes of memory for each draw of an iteration. Measured: 14.
const MEMORY_PER_DRAW: u64 = 32;

/// Bytes of memory for the pixels of a round. An estimate: up to 16 KiB a pixel, in front of a
/// trained background.
const MEMORY_OF_ROUND: u64 = 64 << 20;

/// Pixels for each one that a silhouette may cross. Half of them are crossed in a fit of images of
/// 32 × 32 pixels, and a fiftieth on `spot`.
const PIXELS_PER_CROSSED: usize = 2;

/// Bytes of memory for each sample of such a pixel. Measured: 5 KiB for the two lines of an edge
/// sample of `refined`. An estimate for other samples.
const MEMORY_PER_EDGE_SAMPLE: u64 = 5 << 10;

/// Bytes of memory for each parameter of the network: the parameters, their packed copies, the
/// moments of Adam, the copies of a checkpoint that is written, and 16 partial sums of the
/// gradient. Measured: 116 for 16 sums, before the weights were packed for a few points too. These
/// are 8 more for each of two networks, and 16 at widths just above a multiple of 32.
const MEMORY_PER_PARAMETER: u64 = 160;

impl FitOptions {
    /// Checks every option. `source` is their origin, for the message of the error.
    ///
    /// # Errors
    /// On the first value that is not valid, an estimator that is not in `registry`, or a network
    /// or a batch that needs more memory than there is.
    pub fn validate(&self, source: &Path, registry: &Registry) -> Result<(), InputError> {
        if registry.get(&self.estimator).is_none() {
            let expected = format!("one of {}", registry.names());
            return Err(InputError::new(source, "estimator", &self.estimator, expected));
        }
        refuse_invalid(source, self.checks())?;
        let warp = WarpOptions::from(self.warp).validate();
        warp.map_err(|e| InputError::new(source, e.name, e.found, e.expected))?;
        let found = format!("{} layers of width {}", self.layers, self.width);
        check_memory(source, "width", found, self.network_memory())?;
        let memory = MEMORY_PER_DRAW * self.batch as u64 + MEMORY_OF_ROUND;
        check_memory(source, "batch", format!("{} pixels", self.batch), memory)?;
        let crossed = self.batch.min(loss::ROUND).div_ceil(PIXELS_PER_CROSSED) as u64;
        let (rays, edges) = (self.edge_rays, self.edge_samples);
        let memory = crossed * (u64::from(rays) + u64::from(edges)) * MEMORY_PER_EDGE_SAMPLE;
        let found = format!("{edges} samples, and {rays} of edge_rays");
        check_memory(source, "edge_samples", found, memory)
    }

    /// An estimate of the memory of a network, its optimiser and its gradients, in bytes.
    fn network_memory(&self) -> u64 {
        let network = self.field_parameters() * MEMORY_PER_PARAMETER;
        network + spline_size(&self.grid).memory(is_fine, MEMORY_PER_PARAMETER)
    }

    /// The number of parameters of the network, without those of nodes of fine levels.
    pub(crate) fn field_parameters(&self) -> u64 {
        let grid = spline_size(&self.grid);
        let features = encoding(self.bands).features() + grid.feature_count();
        let coarse = grid.levels.iter().filter(|side| !is_fine(**side));
        let coefficients: usize = coarse.map(|side| side.pow(3) * grid.features).sum();
        mlp_parameters(features, self.width, self.layers, 1) + coefficients as u64
    }

    /// The checks of all options but the estimator and those of the warp.
    fn checks(&self) -> Vec<Check> {
        let (radius, soft, rate) = (self.initial_radius, self.soft(), self.learning_rate());
        vec![
            Check::at_least_one("iterations", self.iterations.unwrap_or(1)),
            Check::seed("seed", self.seed),
            Check::at_least_one("downscale", self.downscale.unwrap_or(1).into()),
            Check::new("width", self.width, (1..=4096).contains(&self.width), "1 to 4096"),
            Check::new("layers", self.layers, (1..=64).contains(&self.layers), "1 to 64"),
            Check::new("bands", self.bands, self.bands <= 12, "at most 12"),
            Check::new("grid", &self.grid, self.grid.is_valid(), GridLevels::EXPECTED),
            Check::new(
                "beta",
                self.beta,
                (1e-3..=1e6).contains(&self.beta),
                "a number from 0.001 to 1000000",
            ),
            Check::new(
                "initial_radius",
                radius,
                radius > 0.0 && radius < 1.0,
                "a fraction between 0 and 1",
            ),
            Check::new(
                "learning_rate",
                rate,
                rate > 0.0 && rate <= 1.0,
                "a number above 0, at most 1",
            ),
            Check::new("batch", self.batch, (1..=MAX_BATCH).contains(&self.batch), "1 to 16777216"),
            Check::samples("edge_rays", self.edge_rays),
            Check::samples("edge_samples", self.edge_samples),
            Check::new(
                "sample_limit",
                self.sample_limit,
                self.sample_limit > 0.0,
                "a number above 0, or inf",
            ),
            // At 1 or less, the running mean falls in every iteration, and the fit stops moving.
            Check::new("clip", self.clip, self.clip > 1.0, "a number above 1, or inf"),
            Check::weight("eikonal", self.eikonal),
            Check::weight("bending", self.bending),
            Check::weight("patches", self.patches.unwrap_or(0.0)),
            Check::new(
                "patches",
                self.patches.unwrap_or(0.0),
                self.patches.unwrap_or(0.0) == 0.0 || !self.refines_lenses(),
                "0 with refined distortion (refine_cameras is all)",
            ),
            Check::new("soft", soft, (0.0..1.0).contains(&soft), "at least 0, below 1"),
            Check::at_least_one("schedule_threads", self.schedule_threads.unwrap_or(1) as u64),
            Check::at_least_one("checkpoint_every", self.checkpoint_every),
            Check::at_least_one("preview_every", self.preview_every),
        ]
    }

    /// The largest learning rate. The file of a run has the option, by
    /// [`learning_rate_for`](Self::learning_rate_for).
    pub(crate) fn learning_rate(&self) -> f64 {
        self.learning_rate.unwrap_or(LEARNING_RATE)
    }

    /// The largest learning rate of a new run, for a background that is trained or not.
    pub(crate) fn learning_rate_for(&self, is_trained: bool) -> f64 {
        self.learning_rate.unwrap_or(if is_trained { LEARNING_RATE } else { PLAIN_RATE })
    }

    /// The weight of the term of patches before its fall. Its cameras have no lens.
    pub(crate) fn patch_weight(&self) -> f64 {
        self.patches.unwrap_or(if self.refines_lenses() { 0.0 } else { PATCHES })
    }

    /// Whether radial distortion is refined.
    fn refines_lenses(&self) -> bool {
        self.refine_cameras.freedom().is_some_and(|freedom| freedom.lens)
    }

    /// The options of the estimator.
    pub(crate) fn estimator_options(&self) -> EstimatorOptions {
        EstimatorOptions { warp: self.warp.into(), baseline: self.baseline }
    }

    /// The way in which an iteration adds up the coefficients of its samples.
    pub(crate) fn pass(&self) -> Pass<f32> {
        let limit = self.sample_limit as f32;
        if limit.is_finite() { Pass::Limited(limit) } else { Pass::Sum }
    }

    /// The numbers of samples in a pixel that a silhouette may cross.
    pub(crate) fn counts(&self) -> SampleCounts {
        SampleCounts { spp: self.edge_rays, edge_samples: self.edge_samples }
    }

    /// The bounding sphere of `--bounds`, in world units; `None` without the option.
    pub fn bounds(&self) -> Option<Sphere<f64>> {
        self.bounds.map(|[x, y, z, radius]| Sphere { center: DVec3::new(x, y, z), radius })
    }
}

/// Refuses the first value that is not valid. `source` is the origin of the values.
pub(crate) fn refuse_invalid(source: &Path, checks: Vec<Check>) -> Result<(), InputError> {
    Check::all(checks).map_err(|e| InputError::new(source, e.name, e.found, e.expected))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_equal_after_writing_and_reading_toml() {
        let mut options =
            FitOptions { time: Some(Duration::from_secs(600)), ..FitOptions::default() };
        options.bounds = Some([0.0, 1.0, 2.0, 3.0]);
        (options.sample_limit, options.clip) = (f64::INFINITY, f64::INFINITY);
        options.baseline = Baseline::None;
        let text = toml::to_string(&options).unwrap();
        assert_eq!(toml::from_str::<FitOptions>(&text).unwrap(), options);
    }

    #[test]
    fn absent_entries_have_the_defaults_of_fits() {
        assert_eq!(toml::from_str::<FitOptions>("").unwrap(), FitOptions::default());
        let options = toml::from_str::<FitOptions>("[warp]\nsteps = 30").unwrap();
        let warp = WarpOptions { steps: 30, ..WarpOptions::FIT }.into();
        assert_eq!(options, FitOptions { warp, ..FitOptions::default() });
        let error = toml::from_str::<FitOptions>("[warp]\nk = 7").unwrap_err();
        let expected = "`steps`, `top_k`, `gamma`, `lambda_d`, `epsilon`";
        assert_eq!(error.message(), format!("unknown field `k`, expected one of {expected}"));
    }

    #[test]
    fn the_error_of_an_invalid_value_names_its_option() {
        let (source, registry) = (Path::new("arguments"), Registry::default());
        let with_warp = |warp: WarpOptions| {
            let warp = warp.into();
            FitOptions { warp, ..FitOptions::default() }
        };
        let cases = [
            (with_warp(WarpOptions { top_k: 1, ..WarpOptions::FIT }), "top_k"),
            (with_warp(WarpOptions { gamma: f64::NAN, ..WarpOptions::FIT }), "gamma"),
            (FitOptions { estimator: "none".to_owned(), ..FitOptions::default() }, "estimator"),
            (FitOptions { batch: 0, ..FitOptions::default() }, "batch"),
            (FitOptions { seed: 1 << 63, ..FitOptions::default() }, "seed"),
            (FitOptions { preview_every: 1 << 63, ..FitOptions::default() }, "preview_every"),
            (FitOptions { sample_limit: 0.0, ..FitOptions::default() }, "sample_limit"),
            (FitOptions { sample_limit: f64::NAN, ..FitOptions::default() }, "sample_limit"),
            (FitOptions { clip: 1.0, ..FitOptions::default() }, "clip"),
            (FitOptions { clip: f64::NAN, ..FitOptions::default() }, "clip"),
        ];
        for (options, name) in cases {
            assert_eq!(options.validate(source, &registry).unwrap_err().field, name);
        }
        FitOptions::default().validate(source, &registry).unwrap();
    }

    #[test]
    fn an_infinite_sample_limit_is_no_limit() {
        let pass = |sample_limit| FitOptions { sample_limit, ..FitOptions::default() }.pass();
        assert_eq!(pass(1.0), Pass::Limited(1.0));
        // 1e300 is an infinity in single precision.
        assert_eq!([pass(f64::INFINITY), pass(1e300)], [Pass::Sum, Pass::Sum]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_network_beyond_the_memory_is_refused() {
        let large = FitOptions { width: 4096, layers: 64, ..FitOptions::default() };
        // 63 layers of 4096² weights: 169 GB with their optimiser.
        assert_eq!(large.network_memory() / 1_000_000_000, 169);
        let huge = FitOptions { width: 1 << 20, layers: 1 << 10, ..large };
        let found = format!("{} layers of width {}", huge.layers, huge.width);
        let error = check_memory("arguments", "width", found, huge.network_memory()).unwrap_err();
        let start = "arguments: width: found 1024 layers of width 1048576, which needs ";
        assert!(error.to_string().starts_with(start), "{error}");
    }
}
