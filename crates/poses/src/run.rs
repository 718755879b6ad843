//! The run of all steps that are not done.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use dataset::readers::sparse_model;
use files::{InputError, WriteError};

use crate::Error;
use crate::advice::{FEW_REGISTERED, remedies};
use crate::commands::{
    BUILDER, Call, DATABASE, GLOBAL_MAPPER, Guided, Mapper, Options, Places, arguments, can_guide,
    list_name,
};
use crate::output::Log;
use crate::photographs::Photographs;
use crate::program::{End, Program};
use crate::result::{Poses, models};
use crate::state::State;
use crate::step::{Entry, Step};

/// The folder of intermediate results in that of a data set.
const WORK: &str = "colmap";

/// The folders of a data set: of undistorted photographs, and of their model.
const RESULTS: [&str; 2] = ["images", "sparse"];

/// The steps whose results depend on a guide.
const GUIDED_STEPS: [Step; 2] = [Step::Matching, Step::Mapping];

/// A search for the poses of photographs.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The photographs.
    pub photographs: &'a Photographs,
    /// The folder of the data set.
    pub output: &'a Path,
    /// The options.
    pub options: &'a Options,
    /// The program.
    pub program: &'a Program,
    /// The most threads.
    pub threads: usize,
}

/// News of a run.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// This part of the photographs is decoded, 0 to 1: a damaged one ends the run before COLMAP
    /// starts.
    Decoding(f64),
    /// These steps are done already.
    Kept(&'a [Step]),
    /// A data set that was complete is made again from this step on: its options are others, its
    /// results are gone, or COLMAP has another version.
    Again(Step),
    /// Few photographs have a pose: matching begins again, guided by the first matches.
    Guided,
    /// A step starts.
    Started(Step),
    /// A part of a step is done.
    Progress {
        /// The step.
        step: Step,
        /// The part, 0 to 1.
        fraction: f64,
        /// The part in words.
        text: &'a str,
    },
    /// A step is done.
    Finished(Step),
}

/// Finds the poses of photographs, from the first step on that is not done.
///
/// If fewer than [`FEW_REGISTERED`] of them have a pose, matching begins again by default, guided
/// by the first matches ([`Guided`]); if it finds fewer poses, those before it are kept.
///
/// The folder of the data set gets the undistorted photographs and their model, which every reader
/// of COLMAP's files reads. `stop` is asked often; when it is true, COLMAP is ended, and `None` is
/// returned. The same job continues then.
///
/// # Errors
/// [`Error::Input`] if the folder has other files, or belongs to other photographs, if a photograph
/// cannot be decoded, or if a path is not in UTF-8. [`Error::Colmap`] if COLMAP is missing or a
/// step fails, and [`Error::NoPose`] if no pose is found. The others if a file cannot be written.
pub fn run(
    job: &Job<'_>,
    stop: &dyn Fn() -> bool,
    show: &mut dyn FnMut(Event<'_>),
) -> Result<Option<Poses>, Error> {
    job.options.check(job.photographs)?;
    for (path, field) in [(&*job.photographs.folder, "photographs"), (job.output, "output")] {
        check_utf8(path, field)?;
    }
    let state = State::of(job.output, job.photographs)?;
    let settings = job.settings(&state);
    if job.done(&state, &settings) == Step::ALL.len()
        && let Some(poses) = &state.result
    {
        show(Event::Kept(&Step::ALL));
        return Ok(Some(Poses { dataset: job.output.to_owned(), ..poses.clone() }));
    }
    // The program first: without it, nothing is written.
    let version = job.program.version()?;
    job.check_mapper(&version)?;
    let done_of =
        |state: &State| if state.colmap == version { job.done(state, &settings) } else { 0 };
    // COLMAP leaves photographs out that it cannot decode.
    if done_of(&state) == 0 && !job.decode(stop, show)? {
        return Ok(None);
    }
    let lock = job.lock()?;
    let mut state = State::of(job.output, job.photographs)?;
    let done = done_of(&state);
    let was_complete = state.result.is_some();
    state.colmap.clone_from(&version);
    state.done.truncate(done);
    state.result = None;
    show(Event::Kept(&Step::ALL[..done]));
    if let Some(entry) = settings.get(done).filter(|_| was_complete) {
        show(Event::Again(entry.step));
    }
    let mut log = Log::open(job.output, done > 0)?;
    if !job.run_steps(settings, &mut state, (&mut log, &lock), stop, show)? {
        return Ok(None);
    }
    let found = models(&job.result_of(Step::Mapping))?;
    let found: Vec<_> = found.into_iter().map(|(_, model)| model).collect();
    let poses = Poses::new(job.output, job.photographs, &found, job.options)?;
    state.result = Some(poses.clone());
    state.save(job.output)?;
    Ok(Some(poses))
}

impl Job<'_> {
    /// All steps with the options that their results depend on. A search that was guided stays so.
    fn settings(&self, state: &State) -> Vec<Entry> {
        let was_guided = || state.done.iter().chain(&state.started).any(Entry::is_guided);
        let is_guided = match self.options.guided {
            Guided::Auto => was_guided(),
            Guided::Always => true,
            Guided::Never => false,
        };
        self.options.settings(self.photographs, is_guided)
    }

    /// Refuses a mapper that the installed version lacks, before the work of the other steps.
    fn check_mapper(&self, version: &str) -> Result<(), Error> {
        let has_command = || Ok::<_, Error>(self.program.help(GLOBAL_MAPPER)?.has("database_path"));
        if self.options.mapper == Mapper::Global && !has_command()? {
            let found = format!("one by `colmap {GLOBAL_MAPPER}`, which COLMAP {version} lacks");
            let expected = "incremental, or COLMAP 4 or later";
            return Err(InputError::new("arguments", "--mapper", found, expected).into());
        }
        Ok(())
    }

    /// Whether matching can begin again, guided.
    fn may_guide(&self, settings: &[Entry]) -> Result<bool, Error> {
        if self.options.guided != Guided::Auto || settings.iter().any(Entry::is_guided) {
            return Ok(false);
        }
        let calls = self.options.calls(Step::Matching, self.photographs);
        Ok(can_guide(&self.program.help(calls[0].command)?))
    }

    /// Whether few photographs have a pose, and guided matching can find more.
    fn is_worth_a_guide(&self, settings: &[Entry]) -> Result<bool, Error> {
        let registered = registered(&self.result_of(Step::Mapping))?;
        let is_few = (registered as f64) < FEW_REGISTERED * self.photographs.count() as f64;
        Ok(is_few && self.may_guide(settings)?)
    }

    /// Goes back to matching, which is guided from now on. The poses so far are put aside.
    fn guide(
        &self,
        state: &mut State,
        show: &mut dyn FnMut(Event<'_>),
    ) -> Result<Vec<Entry>, Error> {
        for step in GUIDED_STEPS {
            remove(&self.first_of(step))?;
            if self.result_of(step).is_dir() {
                rename(&self.result_of(step), &self.first_of(step))?;
            }
        }
        state.done.retain(|entry| entry.step < Step::Matching);
        show(Event::Guided);
        Ok(self.options.settings(self.photographs, true))
    }

    /// Whether more photographs had a pose before matching was guided.
    fn was_better_without_a_guide(&self) -> Result<bool, Error> {
        let first = self.first_of(Step::Mapping);
        Ok(first.is_dir() && registered(&first)? > registered(&self.result_of(Step::Mapping))?)
    }

    /// Takes the poses back that were found without a guide.
    fn take_back(&self, state: &mut State) -> Result<Vec<Entry>, Error> {
        for step in GUIDED_STEPS {
            remove(&self.result_of(step))?;
            rename(&self.first_of(step), &self.result_of(step))?;
        }
        let settings = self.options.settings(self.photographs, false);
        state.done = settings[..Step::Undistortion as usize].to_vec();
        state.started = None;
        state.save(self.output)?;
        Ok(settings)
    }

    /// The folder of a step's results without a guide, while guided ones are made.
    fn first_of(&self, step: Step) -> PathBuf {
        self.output.join(WORK).join(format!("{step}.first"))
    }

    /// Decodes all photographs. Returns whether it was not stopped.
    fn decode(
        &self,
        stop: &dyn Fn() -> bool,
        show: &mut dyn FnMut(Event<'_>),
    ) -> Result<bool, InputError> {
        show(Event::Decoding(0.0));
        let all = self.photographs.count() as f64;
        for number in 0..self.photographs.count() {
            if stop() {
                return Ok(false);
            }
            self.photographs.decode(number)?;
            show(Event::Decoding((number + 1) as f64 / all));
        }
        Ok(true)
    }

    /// The folder of a step's results.
    fn result_of(&self, step: Step) -> PathBuf {
        match step {
            Step::Undistortion => self.output.join(RESULTS[1]),
            step => self.output.join(WORK).join(step.name()),
        }
    }

    fn partial_of(&self, step: Step) -> PathBuf {
        self.output.join(WORK).join(step.partial())
    }

    /// The number of steps, from the first one on, that are done with these settings and have their
    /// results.
    fn done(&self, state: &State, settings: &[Entry]) -> usize {
        let has_results = |entry: &&Entry| {
            let is_there = self.result_of(entry.step).is_dir();
            is_there && (entry.step != Step::Undistortion || self.has_images())
        };
        let done = state.done_with(settings);
        settings[..done].iter().take_while(has_results).count()
    }

    /// Whether every photograph with a pose is there without distortion.
    fn has_images(&self) -> bool {
        let images = self.output.join(RESULTS[0]);
        sparse_model(&self.output.join(RESULTS[1]))
            .is_ok_and(|model| model.images.iter().all(|name| images.join(name).is_file()))
    }

    /// Locks the folder for this process, and removes the temporary files of others that ended.
    fn lock(&self) -> Result<File, Error> {
        files::check_output_folder(self.output)?;
        let work = self.output;
        fs::create_dir_all(work)
            .map_err(|e| InputError::new(work, "output", e, "a folder that can be written"))?;
        let Some(lock) = files::lock(&work.join("lock"))? else {
            let found = "another `dsdf poses`, or a COLMAP that it started, at work in this folder";
            let expected = "a folder without one: wait for it, or choose another";
            return Err(InputError::new(work, "output", found, expected).into());
        };
        files::remove_abandoned_temporary_files(work);
        Ok(lock)
    }

    /// Runs the steps that are not done, matching twice if few photographs have a pose. Returns
    /// whether it was not stopped.
    fn run_steps(
        &self,
        mut settings: Vec<Entry>,
        state: &mut State,
        (log, lock): (&mut Log, &File),
        stop: &dyn Fn() -> bool,
        show: &mut dyn FnMut(Event<'_>),
    ) -> Result<bool, Error> {
        let mut is_tried = false;
        while let Some(entry) = settings.get(state.done.len()) {
            if entry.step == Step::Undistortion {
                if !is_tried && self.is_worth_a_guide(&settings)? {
                    is_tried = true;
                    settings = self.guide(state, show)?;
                    continue;
                }
                if self.was_better_without_a_guide()? {
                    settings = self.take_back(state)?;
                }
            }
            let entry = &settings[state.done.len()];
            show(Event::Started(entry.step));
            match self.run_step(entry, state, (log, lock), stop, show) {
                Ok(true) => show(Event::Finished(entry.step)),
                Ok(false) => return Ok(false),
                Err(Error::NoPose(_)) if !is_tried && self.may_guide(&settings)? => {
                    is_tried = true;
                    settings = self.guide(state, show)?;
                }
                Err(Error::NoPose(_)) if self.first_of(Step::Mapping).is_dir() => {
                    settings = self.take_back(state)?;
                }
                Err(error) => return Err(error),
            }
        }
        for step in GUIDED_STEPS {
            remove(&self.first_of(step))?;
        }
        Ok(true)
    }

    /// Runs a step, and notes it as done. Returns whether it was not stopped.
    fn run_step(
        &self,
        entry: &Entry,
        state: &mut State,
        (log, lock): (&mut Log, &File),
        stop: &dyn Fn() -> bool,
        show: &mut dyn FnMut(Event<'_>),
    ) -> Result<bool, Error> {
        let step = entry.step;
        let partial = self.partial_of(step);
        // COLMAP notes each pair in its database, and continues with the others.
        let continues = step == Step::Matching
            && state.started.as_ref() == Some(entry)
            && partial.join(DATABASE).is_file();
        self.clear_from(step, continues)?;
        state.started = Some(entry.clone());
        state.save(self.output)?;
        if !continues {
            self.prepare(step, &partial)?;
        }
        let calls = self.options.calls(step, self.photographs);
        let (count, mut before) = (self.photographs.count(), 0);
        for (number, Call { command, group }) in calls.iter().enumerate() {
            // The parts of the features are of all photographs already.
            let of_step = |part: f64| match step {
                Step::Features => part,
                _ => (number as f64 + part) / calls.len() as f64,
            };
            let words = self.command_line(entry, command, &partial, number)?;
            log.begin(&words)?;
            let end = self.program.run(&words, lock, stop, &mut |line| {
                if let Some((part, text)) = step.progress(line, count, before) {
                    show(Event::Progress { step, fraction: of_step(part), text: &text });
                }
                log.add(line)
            })?;
            match end {
                End::Stopped => return Ok(false),
                End::Failed(status) => return Err(self.failure(step, command, &status, log)),
                End::Done => before += group.len(),
            }
        }
        self.accept(step, &partial, log)?;
        state.done.push(entry.clone());
        state.save(self.output)?;
        Ok(true)
    }

    /// Removes the intermediate results of a step and of all after it. The data set stays until a
    /// new one takes its place. `keeps_partial` is about the results of the step itself, from a run
    /// that was stopped.
    fn clear_from(&self, step: Step, keeps_partial: bool) -> Result<(), Error> {
        for later in Step::ALL.into_iter().filter(|later| *later >= step) {
            if later != step || !keeps_partial {
                remove(&self.partial_of(later))?;
            }
            if later != Step::Undistortion {
                remove(&self.result_of(later))?;
            }
        }
        Ok(())
    }

    /// Makes the folder in which a step writes, with the files that COLMAP expects there.
    fn prepare(&self, step: Step, partial: &Path) -> Result<(), WriteError> {
        let error = |e| WriteError::of_folder(partial, e);
        fs::create_dir_all(partial).map_err(error)?;
        match step {
            Step::Features => {
                let groups = self.options.groups(self.photographs);
                groups.iter().enumerate().try_for_each(|(number, group)| {
                    let list = partial.join(list_name(number));
                    fs::write(list, self.photographs.list(group)).map_err(error)
                })
            }
            Step::Matching => {
                let from = self.result_of(Step::Features).join(DATABASE);
                fs::copy(&from, partial.join(DATABASE)).map(drop).map_err(error)
            }
            Step::Mapping | Step::Undistortion => Ok(()),
        }
    }

    /// The command line of a step.
    fn command_line(
        &self,
        entry: &Entry,
        command: &str,
        partial: &Path,
        group: usize,
    ) -> Result<Vec<String>, Error> {
        let step = entry.step;
        let input = match step {
            Step::Features | Step::Matching => PathBuf::new(),
            Step::Mapping => self.result_of(Step::Matching).join(DATABASE),
            Step::Undistortion => {
                let all = models(&self.result_of(Step::Mapping))?;
                let none = || Error::Colmap("the mapping has no model".to_owned());
                all.into_iter().next().ok_or_else(none)?.0
            }
        };
        // A path that starts with a dash would be an option.
        let [images, input, output] = [&self.photographs.folder, &input, partial].map(absolute);
        let list = output.join(list_name(group));
        let places = Places { images: &images, input: &input, output: &output, list: &list };
        let help = self.program.help(command)?;
        let (options, photographs) = (self.options, self.photographs);
        let mut words = vec![command.to_owned()];
        words.extend(arguments(entry, options, photographs, self.threads, &places, &help)?);
        Ok(words)
    }

    /// Gives the results of a finished step their names.
    fn accept(&self, step: Step, partial: &Path, log: &Log) -> Result<(), Error> {
        let expected = match step {
            Step::Features | Step::Matching => partial.join(DATABASE),
            Step::Mapping => partial.join("0"),
            Step::Undistortion => partial.join(RESULTS[1]),
        };
        if !expected.exists() {
            if step == Step::Mapping {
                return Err(self.no_pose(log));
            }
            let (expected, log) = (expected.display(), log.path().display());
            return Err(Error::Colmap(format!("COLMAP ended {step} without {expected} ({log})")));
        }
        if step != Step::Undistortion {
            return rename(partial, &self.result_of(step));
        }
        for name in RESULTS {
            remove(&self.output.join(name))?;
            rename(&partial.join(name), &self.output.join(name))?;
        }
        // The rest is for COLMAP's own surfaces.
        remove(partial)
    }

    /// The error of a step that failed.
    fn failure(&self, step: Step, command: &str, status: &str, log: &Log) -> Error {
        let has_model = self.partial_of(step).join("0").is_dir();
        // The mapper fails if it makes no model.
        if step == Step::Mapping && !has_model && status == "ended with status 1" {
            return self.no_pose(log);
        }
        // There are fewer features than words of a vocabulary: COLMAP ends by a failed check.
        if command == BUILDER && log.error().contains("num_visual_words") {
            return self.no_pose(log);
        }
        let (error, log) = (log.error(), log.path().display());
        let error = if error.is_empty() { "it printed nothing" } else { error };
        Error::Colmap(format!("colmap {command} {status}: {error} (all its output: {log})"))
    }

    fn no_pose(&self, log: &Log) -> Error {
        let count = self.photographs.count();
        let remedies = remedies(self.options.matching_of(count)).join("; ");
        Error::NoPose(format!(
            "{}: COLMAP found no pose: it could not connect any group of the {count} photographs \
             (its output: {}); {remedies}",
            self.photographs.folder.display(),
            log.path().display()
        ))
    }
}

/// The number of photographs with a pose in the largest model in a folder.
fn registered(folder: &Path) -> Result<usize, InputError> {
    Ok(models(folder)?.first().map_or(0, |(_, model)| model.images.len()))
}

/// Refuses a path that cannot be an argument of COLMAP, also where the part before it is to blame.
fn check_utf8(path: &Path, field: &str) -> Result<(), InputError> {
    let found = || format!("{} as its path from the root", absolute(path).to_string_lossy());
    let expected = "a path in UTF-8";
    absolute(path)
        .to_str()
        .map(|_| ())
        .ok_or_else(|| InputError::new(path, field, found(), expected))
}

/// The path from the root.
fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Removes a folder if it exists.
fn remove(folder: &Path) -> Result<(), Error> {
    match fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::system(format!("remove {}", folder.display()))(e))
        }
        _ => Ok(()),
    }
}

fn rename(from: &Path, to: &Path) -> Result<(), Error> {
    fs::rename(from, to).map_err(Error::system(format!("rename {}", from.display())))
}
