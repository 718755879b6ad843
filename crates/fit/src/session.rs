//! A fit with its run folder: to the end of the budget, with metrics, previews and checkpoints.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use dataset::Dataset;
use estimate::Registry;
use files::{ARGUMENTS, InputError};
use loss::{Observer, Workspace};

use crate::checkpoint::{LatticeState, Optimised, State};
use crate::error::FitError;
use crate::fit::Fit;
use crate::lattice::FieldLattice;
use crate::metrics::Metrics;
use crate::metrics_file::MetricsFile;
use crate::model::Model;
use crate::options::FitOptions;
use crate::preview::preview;
use crate::run_file::RunFile;
use crate::run_folder::RunFolder;
use crate::survey::restore_survey;

/// A fit with its run folder. It writes the results, checkpoints, metrics and previews. The folder
/// and its subfolders must exist; [`RunFile::save`] writes `fit.toml`.
#[derive(Debug)]
pub struct Session {
    /// The fit.
    pub fit: Fit,
    folder: RunFolder,
    held_out_psnr: Option<f64>,
    work: Workspace,
}

impl Session {
    /// Starts a fit in the run folder `folder`, or with `resume` continues from the checkpoint
    /// there. It writes no file. The estimator that the options name comes from `registry`.
    ///
    /// # Errors
    /// If an option is not valid, a side of a photograph has more than 65,535 pixels, no ray of a
    /// pixel meets the bounding sphere, or the checkpoint cannot be used.
    pub fn new(
        folder: &Path,
        dataset: Dataset,
        file: RunFile,
        registry: &Registry,
        resume: bool,
    ) -> Result<Self, FitError> {
        let folder = RunFolder::new(folder);
        let source = folder.fit_toml();
        file.options.validate(&source, registry)?;
        // Before the model, which may be large: the checkpoint tells whether it is that of the run.
        let state = if resume { Some(load_state(&folder, &file)?) } else { None };
        let fit = Fit::of_valid(dataset, file, registry, &source)?;
        let work = Workspace::default();
        let mut session = Session { fit, folder, held_out_psnr: None, work };
        if let Some(state) = state {
            session.restore(state)?;
        }
        Ok(session)
    }

    /// Shows the tasks of iterations to an observer, and shares them as for this number of threads.
    pub fn observe(&mut self, workers: usize, observer: Observer) {
        self.work = Workspace::observed(workers, observer);
    }

    /// The run folder.
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// PSNR of the last preview of a held-out view, in dB.
    pub fn held_out_psnr(&self) -> Option<f64> {
        self.held_out_psnr
    }

    /// Runs iterations until the budget is spent or `stop` is true, and saves. At the end of the
    /// budget, it writes the preview first.
    ///
    /// `report` gets the session and the metrics after every iteration; its time counts as time of
    /// the fit. The folders of the checkpoint and of previews must exist in the run folder.
    ///
    /// # Errors
    /// If the field or a gradient is not finite, a file cannot be written, or `report` fails.
    pub fn run<E: From<FitError>>(
        &mut self,
        stop: &dyn Fn() -> bool,
        report: &mut dyn FnMut(&Self, &Metrics) -> Result<(), E>,
    ) -> Result<(), E> {
        self.fit.find_depths(stop, &mut |_, _| {});
        let iteration = self.fit.clock.iteration;
        let mut lines =
            MetricsFile::open(&self.folder.metrics(), iteration).map_err(FitError::from)?;

        let (begin, before) = (Instant::now(), self.fit.clock.seconds);
        while self.fit.progress() < 1.0 && !stop() {
            let step = self.fit.step(&mut self.work)?;
            let seconds = before + begin.elapsed().as_secs_f64();
            let taken = seconds - self.fit.clock.seconds;
            self.fit.clock.seconds = seconds;
            let metrics = Metrics {
                seconds,
                progress: self.fit.progress(),
                psnr: self.held_out_psnr,
                rays_per_second: step.rays as f64 / taken.max(1e-9),
                step,
            };
            lines.write(&metrics).map_err(FitError::from)?;
            report(self, &metrics)?;

            let FitOptions { preview_every, checkpoint_every, .. } = self.fit.file.options;
            let iteration = self.fit.clock.iteration;
            let is_last = self.fit.progress() >= 1.0;
            if iteration.is_multiple_of(preview_every) && !is_last {
                self.preview()?;
            }
            if iteration.is_multiple_of(checkpoint_every) && !is_last && !stop() {
                self.save()?;
            }
            self.fit.clock.seconds = before + begin.elapsed().as_secs_f64();
        }
        let shown = match self.fit.progress() >= 1.0 {
            true => {
                self.fit.optimiser.take_average(&mut self.fit.model);
                self.preview()
            }
            false => Ok(()),
        };
        // A picture that fails takes no checkpoint with it.
        self.save()?;
        Ok(shown?)
    }

    /// Writes the preview picture of the first held-out view, or else of the first view, with at
    /// most 131,072 pixels. The PSNR of a held-out view at this size enters the next metrics.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray, or the picture cannot be written.
    pub fn preview(&mut self) -> Result<(), FitError> {
        self.held_out_psnr = preview(&self.fit, &self.folder)?;
        Ok(())
    }

    /// Writes the checkpoint and the model files.
    ///
    /// # Errors
    /// If a file cannot be written. The file that was there before then stays complete.
    pub fn save(&self) -> Result<(), FitError> {
        let Session { fit, folder, .. } = self;
        let photographs = &fit.photographs;
        let state = State {
            clock: fit.clock,
            optimiser: fit.optimiser.state(),
            held_out_psnr: self.held_out_psnr,
            corrections: photographs.corrections.map(|own| Optimised::new(own.state())),
            exposures: photographs.gains.as_ref().map(|gains| Optimised::new(gains.state())),
            survey: fit.survey.as_ref().map(Cow::Borrowed),
            lattice: fit.lattice.as_ref().map(|own| Cow::Borrowed(&own.state)),
        };
        state.save(&folder.checkpoint())?;
        if let Some(cameras) = photographs.cameras(fit.file.origin()) {
            cameras.save(folder)?;
        }
        if let Some(exposures) = photographs.exposures() {
            exposures.save(folder)?;
        }
        fit.model.save(folder, fit.file.origin())
    }

    /// Restores the state of a checkpoint.
    fn restore(&mut self, state: State<'_>) -> Result<(), FitError> {
        let checkpoint = self.folder.checkpoint();
        let fit = &mut self.fit;
        fit.clock = state.clock;
        self.held_out_psnr = state.held_out_psnr;
        // It tells the number of parameters.
        restore_survey(fit, state.survey.map(Cow::into_owned), &checkpoint)?;
        fit.optimiser.restore(&mut fit.model, state.optimiser)?;
        let photographs = &mut fit.photographs;
        photographs.restore_exposures(state.exposures.as_ref(), &checkpoint)?;
        photographs.restore_corrections(&state.corrections, &fit.file, &checkpoint)?;
        fit.set_windows();
        let ball = fit.ball();
        let restored = |own: Cow<'_, LatticeState>| {
            FieldLattice::restored(own.into_owned(), &ball, &checkpoint)
        };
        fit.lattice = state.lattice.map(restored).transpose()?;
        Ok(())
    }
}

/// Reads the checkpoint of a run.
fn load_state(folder: &RunFolder, file: &RunFile) -> Result<State<'static>, InputError> {
    let count = |free_nodes| Model::parameter_count(file, free_nodes);
    let state = State::load(&folder.checkpoint(), count)?;
    // The budget may be another one than that of the run: it is from the command line then.
    let kept = RunFile::load(folder.path())?.options;
    let budget = |options: &FitOptions| (options.time, options.iterations);
    let source = match budget(&kept) == budget(&file.options) {
        true => folder.fit_toml(),
        false => PathBuf::from(ARGUMENTS),
    };
    let refused =
        |field, found: String, expected| Err(InputError::new(source, field, found, expected));
    let State { clock, .. } = &state;
    if let Some(budget) = file.options.iterations.filter(|n| *n < clock.iteration) {
        let expected = format!("at least the {} finished iterations", clock.iteration);
        return refused("iterations", budget.to_string(), expected);
    }
    // The last iteration of a fit ends after its time: that of the run itself is no error.
    let is_spent = |time: &Duration| kept.time != Some(*time) && time.as_secs_f64() < clock.seconds;
    if let Some(budget) = file.options.time.filter(is_spent) {
        let expected = format!("at least the {:.0} s that the run has taken", clock.seconds.ceil());
        return refused("time", format!("{} s", budget.as_secs_f64()), expected);
    }
    Ok(state)
}
