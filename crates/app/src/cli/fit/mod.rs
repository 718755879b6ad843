//! `dsdf fit`.

mod expected;
mod growth;
mod options;
mod prepare_run;
mod progress;
mod resume;
mod start;
mod summary;
mod tensorboard;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;

use super::common::{Global, as_fitted, with_flag};
use super::eval::{SAMPLES, compare_views};
use super::report::Live;
use crate::error::Interrupted;
use crate::serve::{Address, Known};
use ::report::{Verdict, live_page};
use dataset::Dataset;
use fit::{Clock, Fit as Fitting, FitError, FitOptions, Metrics, RunFile, RunFolder, Session};
use report::examine;

pub(crate) use options::Fit;
pub(super) use prepare_run::{lock, refuse_occupied};
pub(super) use start::{new_run, read_for};
use tensorboard::Events;

/// The result of `dsdf fit`.
#[derive(Serialize)]
pub(super) struct FitReport {
    /// The run folder.
    run: PathBuf,
    /// Iterations since the start of the run.
    pub(super) iterations: u64,
    /// Wall time of these iterations, in seconds.
    seconds: f64,
    /// Mean photometric loss per pixel of the last iteration; `None` without an iteration.
    loss: Option<f64>,
    /// PSNR in dB, mean over the held-out views, as of `dsdf eval`; before the budget is spent,
    /// that of the last preview, at its size. `None` without held-out views.
    psnr: Option<f64>,
    /// The verdict on the surface and the images; `None` if the budget is not spent.
    pub(super) verdict: Option<Verdict>,
}

impl FitReport {
    pub(super) fn text(&self) -> String {
        let psnr = self.psnr.map_or(String::new(), |p| format!(", held out {p:.2} dB"));
        let run = self.run.display();
        let verdict = self.verdict.as_ref().map_or(String::new(), |v| format!("\n{v}"));
        format!("{} iterations, {:.0} s{psnr}: {run}{verdict}", self.iterations, self.seconds)
    }
}

/// The part of a run that this process does.
#[derive(Clone, Default)]
pub(super) struct Segment {
    /// Whether to start from the checkpoint in the run folder.
    resume: bool,
    /// The iteration, counted from the start of the run, at which to stop although the budget is
    /// not spent.
    stop_after: Option<u64>,
    /// The page to write, now and then.
    page: Option<PathBuf>,
    /// Whether the metrics are events of TensorBoard, too.
    logs_events: bool,
    /// Whether another command runs it as one of its steps, and continues it.
    is_step: bool,
}

impl Fit {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        prepare_run::check_output(&self.output, global)?;
        if !self.resume {
            refuse_occupied(&self.output)?;
        }
        if let Some(address) = self.serve.filter(|_| self.check) {
            address.check()?;
        }
        if self.check {
            self.validate(global)?;
            if self.dataset.is_some() && !self.resume {
                let (dataset, file, source) = self.started_run(global)?;
                summary::print(&dataset, &file, &source, global);
            }
            let valid = serde_json::json!({ "valid": true });
            return global.report(&valid, || "the options are valid".to_owned());
        }
        let page = self.report.then(|| RunFolder::new(&self.output).page());
        if let Some(page) = page.as_ref().filter(|_| self.output.is_dir()) {
            files::check_output(page)?;
        }
        let Fit { resume, stop_after, serve, .. } = *self;
        // The page comes before the photographs are read: nothing is written if it cannot.
        if let Some(address) = serve {
            serve_page(address, &self.output, global)?;
        }
        let logs_events = self.log.is_some();
        let segment = Segment { resume, stop_after, page, logs_events, is_step: false };
        let report = self.fit(segment, global)?;
        global.report(&report, || report.text())
    }

    /// Starts or resumes the fit.
    fn fit(&self, segment: Segment, global: &Global) -> anyhow::Result<FitReport> {
        let (dataset, file, source) =
            if self.resume { self.resumed_run(global)? } else { self.started_run(global)? };
        summary::print(&dataset, &file, &source, global);
        Ok(fit(dataset, file, &self.output, segment, global)?.0)
    }

    /// Fits the data set as a step of another command: from the checkpoint in the run folder `run`,
    /// if there is one, else with a budget of `time`. It writes `page` now and then.
    pub(super) fn as_step(
        dataset: PathBuf,
        run: PathBuf,
        time: Duration,
        page: PathBuf,
        global: &Global,
    ) -> anyhow::Result<FitReport> {
        let resume = RunFolder::new(&run).checkpoint().is_file();
        prepare_run::check_output(&run, global)?;
        if !resume {
            refuse_occupied(&run)?;
        }
        // A run keeps its budget.
        let time = (!resume).then_some(time);
        let options = FitOptions { time, ..FitOptions::default() };
        let segment = Segment { resume, page: Some(page), is_step: true, ..Segment::default() };
        Fit::of_options(dataset, run, resume, options).fit(segment, global)
    }
}

/// Fits a data set in the run folder `run`, with progress, metrics, previews and checkpoints. The
/// data set of the fit has its cameras and exposures as fitted, once the budget is spent.
///
/// # Errors
/// With [`Interrupted`] after Ctrl-C, when the checkpoint is saved; if an input is wrong, another
/// fit is writing the folder, a file cannot be written, a number is not finite, or the fit ends
/// without a surface.
pub(super) fn fit(
    dataset: Dataset,
    file: RunFile,
    run: &Path,
    segment: Segment,
    global: &Global,
) -> anyhow::Result<(FitReport, Session)> {
    let (mut session, lock) = locked_fit(dataset, file, run, segment.resume, global)?;
    if segment.resume && session.fit.progress() >= 1.0 {
        say_spent(session.fit.clock, segment.is_step, global);
    }
    prepare_run::write_run_file(run, &session.fit.file)?;
    let console = &global.console;
    let live = start_page(&segment, run, &session.fit, global)?;
    let last =
        console.while_iterating(|| iterate(&mut session, run, &segment, live.as_ref(), global))?;
    if console.stop_requested() {
        if let Some(live) = &live {
            live.stopped(&session.fit);
        }
        let stopped = session.fit.clock.iteration;
        let how = if segment.is_step { "the same command" } else { "--resume" };
        console.line(&format!("stopped after {stopped} iterations; {how} continues"));
        return Err(Interrupted.into());
    }
    if session.fit.clock.iteration == 0 && session.fit.progress() >= 1.0 {
        global.say(
            "WARNING the time was spent before the first iteration, on the search for depths: give \
             a longer --time, or --stereo none",
        );
    }
    // At the end of the budget, there is one.
    if session.fit.progress() < 1.0 {
        session.preview()?;
    }
    drop(lock);
    refuse_empty(&session.fit, run)?;
    let mut report = FitReport {
        run: run.to_owned(),
        iterations: session.fit.clock.iteration,
        seconds: session.fit.clock.seconds,
        loss: last.map(|m| m.step.loss),
        psnr: session.held_out_psnr(),
        verdict: None,
    };
    if session.fit.progress() >= 1.0 {
        let Fitting { model, file, photographs, .. } = &mut session.fit;
        as_fitted(run, model, file, &mut photographs.dataset, false, global)?;
        let Fitting { model, file, photographs, .. } = &session.fit;
        let dataset = &photographs.dataset;
        let bar = global.progress("held-out views");
        let errors = compare_views(model, file, &dataset.test, SAMPLES, None, &bar.mover())?;
        bar.finish_and_clear();
        report.psnr = errors.psnr.or(report.psnr);
        let verdict = examine(model, file, dataset)?;
        if let Some(live) = live {
            live.finish(&session.fit, &verdict, global)?;
        }
        report.verdict = Some(verdict);
    } else if let Some(live) = live {
        live.stopped(&session.fit);
    }
    Ok((report, session))
}

/// The page of a fit, if it has one.
fn start_page(
    segment: &Segment,
    run: &Path,
    fitting: &Fitting,
    global: &Global,
) -> anyhow::Result<Option<Live>> {
    let site = global.console.site();
    if let Some(site) = site {
        site.known().save(run)?;
    }
    let is_wanted = segment.page.is_some() || site.is_some();
    Ok(is_wanted.then(|| Live::start(run, segment.page.clone(), fitting, &global.console)))
}

/// Starts the server of the page of `run`, unless there is one.
pub(super) fn serve_page(address: Address, run: &Path, global: &Global) -> anyhow::Result<()> {
    let name = run.file_name().unwrap_or(run.as_os_str()).to_string_lossy();
    global.console.serve(address, Known::load(run), || live_page(&name))
}

/// Says that a resumed run has spent its budget already.
fn say_spent(clock: Clock, is_step: bool, global: &Global) {
    let Clock { iteration: iterations, seconds, .. } = clock;
    let spent = format!("{iterations} iterations in {seconds:.0} s");
    global.say(&match is_step {
        true => format!("fit: done already, {spent}"),
        false => format!(
            "WARNING the run has spent this budget: {spent}; a longer --time, or more \
             --iterations, continues it"
        ),
    });
}

/// Fails after the last iteration of a fit without a surface: its images show the background, and
/// it has no mesh. Its files stay.
fn refuse_empty(fitting: &Fitting, run: &Path) -> anyhow::Result<()> {
    if fitting.progress() >= 1.0 && !fitting.has_visible_surface()? {
        anyhow::bail!(
            "{}: the fit ended without a surface: no ray of a training view meets one (try a \
             larger sphere with --bounds, and look at the picture of `dsdf inspect`)",
            run.display()
        );
    }
    Ok(())
}

/// The fit and the lock of its run folder.
///
/// All input is checked before the first file is written: a refused fit leaves no folder behind.
fn locked_fit(
    dataset: Dataset,
    file: RunFile,
    run: &Path,
    resume: bool,
    global: &Global,
) -> anyhow::Result<(Session, std::fs::File)> {
    let new = |dataset, file| {
        let session = Session::new(run, dataset, file, &global.registry, resume);
        session.map_err(|error| match error {
            FitError::Input(input) => anyhow::Error::from(with_flag(input)),
            other => other.into(),
        })
    };
    if resume {
        let lock = lock(run)?;
        return Ok((new(dataset, file)?, lock));
    }
    let session = new(dataset, file)?;
    prepare_run::create(run)?;
    let lock = lock(run)?;
    // Another fit may have ended here since the folder was checked.
    refuse_occupied(run)?;
    Ok((session, lock))
}

/// Iterates until the budget is spent, the segment ends or Ctrl-C is pressed, in a larger
/// sphere if the first one cuts the object off. Returns the metrics of the last iteration.
fn iterate(
    session: &mut Session,
    run: &Path,
    segment: &Segment,
    live: Option<&Live>,
    global: &Global,
) -> anyhow::Result<Option<Metrics>> {
    let mut last: Option<Metrics> = None;
    let is_reached = |done: u64| segment.stop_after.is_some_and(|n| done >= n);
    loop {
        let start = || Events::start(run, session.fit.clock.iteration);
        let mut events = segment.logs_events.then(start).transpose()?;
        let (done, is_due) = (Cell::new(session.fit.clock.iteration), Cell::new(false));
        let requested = || global.console.stop_requested();
        let stop = || requested() || is_reached(done.get()) || is_due.get();
        progress::find_depths(&mut session.fit, &stop, global);
        let bar = progress::start(global);
        let report = &mut |session: &Session, metrics: &Metrics| -> anyhow::Result<()> {
            done.set(metrics.step.iteration);
            is_due.set(growth::is_due(&session.fit));
            if let Some(trial) = &metrics.step.trial {
                global.say(&trial.text());
            }
            progress::show(&bar, metrics);
            if let Some(events) = &mut events {
                events.add(metrics)?;
            }
            last = Some(metrics.clone());
            live.inspect(|live| live.refresh(&session.fit));
            Ok(())
        };
        session.run(&stop, report)?;
        bar.finish_and_clear();
        if requested() || !growth::is_due(&session.fit) {
            return Ok(last);
        }
        growth::examine(session, run, global)?;
        live.inspect(|live| live.begin_again(&session.fit));
    }
}
