//! `dsdf report`, and the page of a fit while it runs.

use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::common::{Global, as_fitted};
use super::fit::read_for;
use crate::error::error_line;
use crate::messages::Console;
use crate::serve::Site;
use ::inspect::inspect;
use ::report::Verdict;
use ::report::{Content, Detail, Run, State};
use dataset::Dataset;
use fit::{Fit as Fitting, FitOptions, Model, RunFile, RunFolder};
use report::{examine, modelled};

/// Arguments of `dsdf report`.
#[derive(Args, Debug)]
pub(crate) struct Report {
    /// Run folder
    run: PathBuf,
    /// Data set folder [default: the data set of the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// Page to write: .html
    #[arg(short, long, default_value = "report.html")]
    output: PathBuf,
}

/// The result of `dsdf report`.
#[derive(Serialize)]
struct Written {
    /// The page.
    page: PathBuf,
    /// Its size, in bytes.
    bytes: usize,
    /// The verdict on the run.
    verdict: Verdict,
}

impl Report {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        global.will_write(&self.output, &["html"])?;
        let file = RunFile::load(&self.run)?;
        let model = Model::load(&self.run, &file)?;
        let downscale = Some(file.downscale());
        let options = FitOptions { downscale, ..FitOptions::default() };
        let (dataset, _) = read_for(file.open(self.dataset.as_deref())?, &options, global)?;
        let mut dataset = file.prepare(dataset);
        let about = About::of(&dataset, &file);
        as_fitted(&self.run, &model, &file, &mut dataset, self.dataset.is_some(), global)?;
        let verdict = examine(&model, &file, &dataset)?;
        let run = about.run(&self.run, (&model, &file, &dataset), State::Ended(&verdict));
        let bytes = write_whole(&run, &self.output, global)?;
        let written = Written { page: self.output.clone(), bytes, verdict };
        global.report(&written, || {
            let (path, size) = (self.output.display(), bytes as f64 / 1e6);
            format!("{path}: {size:.1} MB\nverdict      {}", written.verdict.text)
        })
    }
}

/// The sentences of a page about the photographs.
pub(super) struct About {
    modelled: [String; 2],
    warnings: Vec<String>,
}

impl About {
    /// `dataset` is relative to the run's origin, with the cameras as given.
    pub(super) fn of(dataset: &Dataset, file: &RunFile) -> Self {
        let report = inspect(dataset, &file.sphere(), &file.background(), "");
        About { modelled: modelled(dataset, file), warnings: report.warnings }
    }

    pub(super) fn run<'a>(
        &'a self,
        folder: &'a Path,
        (model, file, dataset): (&'a Model, &'a RunFile, &'a Dataset),
        state: State<'a>,
    ) -> Run<'a> {
        let (modelled, warnings) = (&self.modelled, &self.warnings);
        Run { folder, file, model, dataset, state, modelled, warnings }
    }
}

/// The verdict on a fit that goes on; `None` while the surface is soft: images are blurred then.
fn so_far(fitting: &Fitting) -> anyhow::Result<Option<Verdict>> {
    let Fitting { model, file, photographs, .. } = fitting;
    let is_sharp = fitting.progress() > file.options.soft();
    Ok(is_sharp.then(|| examine(model, file, &photographs.dataset)).transpose()?)
}

/// Writes the page of a run that has ended. Returns its size in bytes.
pub(super) fn write_whole(run: &Run<'_>, path: &Path, global: &Global) -> anyhow::Result<usize> {
    let bar = global.progress("report");
    let html = Content::of(run, Detail::FULL, &bar.mover())?.html()?;
    bar.finish_and_clear();
    write(path, &html)
}

fn write(path: &Path, html: &str) -> anyhow::Result<usize> {
    files::atomic_write(path, |out| out.write_all(html.as_bytes()))?;
    Ok(html.len())
}

/// Seconds from the start of a fit to its first page.
const FIRST_PAGE_AFTER: Duration = Duration::from_secs(10);

/// The time from the end of one page to the start of the next, in times of the first: pages take at
/// most a fiftieth of the time.
const PAUSE: u32 = 50;

/// The page of a fit that goes on: a file, and that of a server, as asked.
pub(super) struct Live {
    about: RefCell<About>,
    folder: RunFolder,
    page: Option<PathBuf>,
    console: Console,
    next: Cell<Instant>,
}

impl Live {
    /// The page of the fit in the run folder `folder`. It is made ten seconds from now first.
    pub(super) fn start(
        folder: &Path,
        page: Option<PathBuf>,
        fitting: &Fitting,
        console: &Console,
    ) -> Self {
        Live {
            about: RefCell::new(About::of(&fitting.photographs.dataset, &fitting.file)),
            folder: RunFolder::new(folder),
            page,
            console: console.clone(),
            next: Cell::new(Instant::now() + FIRST_PAGE_AFTER),
        }
    }

    /// Whether there is a file to write, or a browser shows the page.
    fn is_wanted(&self) -> bool {
        self.page.is_some() || self.console.site().is_some_and(Site::is_watched)
    }

    /// Begins again with the fit, in another sphere.
    pub(super) fn begin_again(&self, fitting: &Fitting) {
        *self.about.borrow_mut() = About::of(&fitting.photographs.dataset, &fitting.file);
    }

    /// Makes the page if it is due and wanted.
    pub(super) fn refresh(&self, fitting: &Fitting) {
        let start = Instant::now();
        if start >= self.next.get() && self.is_wanted() {
            self.warn(so_far(fitting).and_then(|verdict| {
                self.make(fitting, State::Running(verdict.as_ref()), Detail::LIVE, &|_| {})
            }));
            self.next.set(Instant::now() + start.elapsed() * PAUSE);
        }
    }

    /// Makes the page of a fit that was stopped. Its cameras are those of the data set.
    pub(super) fn stopped(&self, fitting: &Fitting) {
        if self.is_wanted() {
            self.warn(self.make(fitting, State::Stopped, Detail::LIVE, &|_| {}));
        }
    }

    /// Says that a page could not be made. The fit goes on without it.
    fn warn(&self, made: anyhow::Result<()>) {
        if let Err(error) = made {
            self.console.line(&format!("WARNING no page: {}", error_line(&error)));
        }
    }

    /// Makes the last page. The data set has the cameras and the exposures as fitted.
    pub(super) fn finish(
        &self,
        fitting: &Fitting,
        verdict: &Verdict,
        global: &Global,
    ) -> anyhow::Result<()> {
        if !self.is_wanted() {
            return Ok(());
        }
        let bar = global.progress("report");
        self.make(fitting, State::Ended(verdict), Detail::FULL, &bar.mover())?;
        bar.finish_and_clear();
        if let Some(page) = &self.page {
            global.say(&format!("report: {}", page.display()));
        }
        Ok(())
    }

    fn make(
        &self,
        fitting: &Fitting,
        state: State<'_>,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> anyhow::Result<()> {
        let Fitting { model, file, photographs, .. } = fitting;
        let about = self.about.borrow();
        let run = about.run(self.folder.path(), (model, file, &photographs.dataset), state);
        let content = Content::of(&run, detail, progress)?;
        if let Some(page) = &self.page {
            write(page, &content.html()?)?;
        }
        // A browser may come later.
        if let Some(site) = self.console.site() {
            site.show(content.json()?);
        }
        Ok(())
    }
}
