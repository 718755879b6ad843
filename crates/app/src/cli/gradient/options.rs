//! The arguments of `dsdf gradient`.

use std::path::PathBuf;

use clap::{ArgMatches, Args};
use estimate::gradient::Sampling;
use estimate::{EstimatorOptions, SampleCounts};
use field::Real;
use files::InputError;
use warp::{WarpArgs, WarpDefaults, WarpOptions};

use crate::cli::common::{PrecisionArg, option_error};
use crate::cli::preset::{Preset, is_explicit};

/// Arguments of `dsdf gradient`.
#[derive(Args, Debug)]
pub(crate) struct Gradient {
    /// Scene file (JSON)
    pub(super) scene: PathBuf,
    /// JSON pointer of the number to differentiate by, for example /sdf/radius; may repeat. For a
    /// neural scene, /sdf/weights/N is the Nth random unit direction in the space of the weights
    #[arg(long, required_unless_present = "target", conflicts_with = "target")]
    pub(super) wrt: Vec<String>,
    /// Target image of the loss, for the gradient by all weights of a neural scene
    #[arg(long)]
    pub(super) target: Option<PathBuf>,
    /// File to write: .npy or .exr with --wrt, .safetensors with --target
    #[arg(short, long)]
    pub(super) output: PathBuf,
    /// Estimator of the derivative [default: refined, or gaussian with --filter gaussian]
    #[arg(long)]
    pub(super) estimator: Option<String>,
    /// Speed/accuracy preset; explicit options override it
    #[arg(long, help_heading = "Sampling", value_enum)]
    preset: Option<Preset>,
    /// Samples per pixel
    #[arg(help_heading = "Sampling")]
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Samples per edge between pixels; for refined, lines per axis of a pixel [default: half of
    /// --spp]
    #[arg(help_heading = "Sampling")]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65536))]
    edge_samples: Option<u32>,
    #[command(flatten, next_help_heading = "Warps")]
    warp: WarpArgs<ImageWarp>,
    /// ρ: length of a tracing step as a fraction of f; below 1 for fields steeper than a distance
    #[arg(long, help_heading = "Tracing", hide_short_help = true, default_value_t = 1.0)]
    relaxation: f64,
    /// Largest |f| of a hit, in bounding radii, or in widths of the film at the surface if these
    /// are smaller [default: 16 units in the last place]
    #[arg(long, help_heading = "Tracing", hide_short_help = true)]
    hit_tolerance: Option<f64>,
    /// Pixel filter, box or gaussian [default: the filter of the estimator]
    #[arg(long, help_heading = "Sampling")]
    pub(super) filter: Option<String>,
    /// Seed of the samples
    #[arg(long, help_heading = "Sampling", default_value_t = 0)]
    seed: u64,
    /// Floating-point precision
    #[arg(long, help_heading = "Sampling", value_enum, default_value = "f64")]
    pub(super) precision: PrecisionArg,
}

/// The defaults of the warp of a derivative image.
#[derive(Clone, Copy, Debug)]
struct ImageWarp;

impl WarpDefaults for ImageWarp {
    const OPTIONS: WarpOptions = WarpOptions::IMAGE;
}

impl Gradient {
    /// Replaces the defaults of options that are not on the command line by the values of the
    /// preset.
    pub(in crate::cli) fn resolve_preset(&mut self, matches: &ArgMatches) {
        if let Some(spp) = self.preset.and_then(Preset::spp)
            && !is_explicit(matches, "spp")
        {
            self.spp = spp;
        }
    }

    /// The numbers of samples and their seed.
    pub(super) fn sampling(&self) -> Sampling {
        let edge_samples = self.edge_samples.unwrap_or_else(|| self.spp.div_ceil(2));
        Sampling { counts: SampleCounts { spp: self.spp, edge_samples }, seed: self.seed }
    }

    /// The options of the estimator.
    pub(super) fn estimator_options(&self) -> EstimatorOptions {
        EstimatorOptions { warp: self.warp.into(), ..EstimatorOptions::default() }
    }

    /// Checks the options of the warp.
    pub(super) fn validate_warp(&self) -> Result<(), InputError> {
        let refused = |e: field::InvalidSetting| option_error(e.name, e.found, e.expected);
        WarpOptions::from(self.warp).validate().map_err(refused)
    }

    /// The options of the tracer, checked.
    pub(super) fn trace_options<R: Real>(&self) -> Result<trace::Options<R>, InputError> {
        let default = trace::Options::<R>::default();
        let tolerance = self.hit_tolerance.map_or(default.tolerance, R::of);
        let options = trace::Options { relaxation: R::of(self.relaxation), tolerance, ..default };
        let flag = |name| if name == "tolerance" { "hit_tolerance" } else { name };
        let refused = |e: field::InvalidSetting| option_error(flag(e.name), e.found, e.expected);
        options.validate().map_err(refused).map(|()| options)
    }

    /// The extensions that the output file may have.
    pub(super) fn extensions(&self) -> &'static [&'static str] {
        if self.target.is_some() { &["safetensors"] } else { &["npy", "exr"] }
    }
}
