//! The arguments of `dsdf fit`.

use std::path::{Path, PathBuf};

use clap::{ArgMatches, Args, ValueEnum};

use crate::cli::common::{ARGUMENTS, Global, with_flag};
use crate::cli::preset::{Preset, is_explicit};
use crate::serve::{Address, THIS_COMPUTER};
use fit::FitOptions;

/// Arguments of `dsdf fit`.
#[derive(Args, Debug)]
pub(crate) struct Fit {
    /// Data set: a folder, or the .json or .xml camera file in it (forms: see the README)
    #[arg(required_unless_present_any = ["resume", "check"])]
    pub(super) dataset: Option<PathBuf>,
    /// Run folder to write
    #[arg(short, long)]
    pub(super) output: PathBuf,
    /// Continue the run of this folder; only --time and --iterations may change
    #[arg(long)]
    pub(super) resume: bool,
    /// Stop at this iteration of the run; --resume continues
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) stop_after: Option<u64>,
    /// Write report.html into the run folder, now and then and at the end
    #[arg(long)]
    pub(super) report: bool,
    /// Show the fit in a browser while it runs: at a port, or an address
    ///
    /// The page has the progress, the surface, renders beside photographs, the curves, and a button
    /// that stops the fit. Without a value, it is at a free port, for this computer alone.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = THIS_COMPUTER)]
    pub(super) serve: Option<Address>,
    /// Write the metrics in another form, too
    ///
    /// RUN/tensorboard gets them as events: `tensorboard --logdir RUN` shows them.
    #[arg(long, value_name = "FORMAT", value_enum)]
    pub(super) log: Option<Log>,
    /// Check the options and the data set, and exit
    #[arg(long)]
    pub(super) check: bool,
    /// Speed/accuracy preset; explicit options override it
    #[arg(long, help_heading = "Budget", value_enum, conflicts_with = "resume")]
    preset: Option<Preset>,
    #[command(flatten)]
    pub(super) options: FitOptions,
    /// The names of the options on the command line.
    #[arg(skip)]
    pub(super) explicit: Vec<String>,
}

/// A further form of the metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Log {
    /// Events of TensorBoard
    Tensorboard,
}

impl Fit {
    /// A fit without options on a command line.
    pub(super) fn of_options(
        dataset: PathBuf,
        output: PathBuf,
        resume: bool,
        options: FitOptions,
    ) -> Self {
        Fit {
            dataset: Some(dataset),
            output,
            resume,
            stop_after: None,
            report: false,
            serve: None,
            log: None,
            check: false,
            preset: None,
            options,
            explicit: Vec::new(),
        }
    }

    /// Replaces the defaults of options that are not on the command line by the values of the
    /// preset, and notes the options that are on the command line. A resumed run keeps its options.
    pub(in crate::cli) fn resolve_preset(&mut self, matches: &ArgMatches) {
        let names = matches.ids().map(|id| id.as_str());
        self.explicit = names.filter(|id| is_explicit(matches, id)).map(str::to_owned).collect();
        let Some(preset) = self.preset.filter(|_| !self.resume) else { return };
        if let Some(iterations) = preset.iterations()
            && !is_explicit(matches, "iterations")
            && !is_explicit(matches, "time")
        {
            self.options.iterations = Some(iterations);
        }
        if let Some(width) = preset.width().filter(|_| !is_explicit(matches, "width")) {
            self.options.width = width;
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    /// Names the first option that cannot work.
    pub(super) fn validate(&self, global: &Global) -> anyhow::Result<()> {
        Ok(self.options.validate(Path::new(ARGUMENTS), &global.registry).map_err(with_flag)?)
    }
}
