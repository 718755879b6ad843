//! The checkpoint of a run: reading and writing it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::checkpoint::State;
use files::{ARGUMENTS, InputError};

use super::Fit;
use crate::model::Model;
use crate::options::FitOptions;
use crate::run_file::RunFile;

/// The checkpoint of a run folder.
pub(super) fn checkpoint_path(folder: &Path) -> PathBuf {
    folder.join("checkpoint").join("state.safetensors")
}

/// Reads the checkpoint of a run.
pub(super) fn load_state(folder: &Path, file: &RunFile) -> anyhow::Result<State> {
    let count = |free_nodes| Model::parameter_count(file, free_nodes);
    let state = State::load(&checkpoint_path(folder), count)?;
    // The budget may be another one than that of the run: it is from the command line then.
    let kept = RunFile::load(folder)?.options;
    let budget = |options: &FitOptions| (options.time, options.iterations);
    let source = match budget(&kept) == budget(&file.options) {
        true => folder.join("fit.toml"),
        false => PathBuf::from(ARGUMENTS),
    };
    let refused = |field, found: String, expected| {
        Err(InputError::new(source, field, found, expected).into())
    };
    if let Some(budget) = file.options.iterations.filter(|n| *n < state.iteration) {
        let expected = format!("at least the {} finished iterations", state.iteration);
        return refused("iterations", budget.to_string(), expected);
    }
    // The last iteration of a fit ends after its time: that of the run itself is no error.
    let is_spent = |time: &Duration| kept.time != Some(*time) && time.as_secs_f64() < state.seconds;
    if let Some(budget) = file.options.time.filter(is_spent) {
        let expected = format!("at least the {:.0} s that the run has taken", state.seconds.ceil());
        return refused("time", format!("{} s", budget.as_secs_f64()), expected);
    }
    Ok(state)
}

impl Fit {
    /// Restores the state of a checkpoint.
    pub(super) fn restore(&mut self, state: State) -> anyhow::Result<()> {
        self.iteration = state.iteration;
        self.seconds = state.seconds;
        self.searching = state.searching;
        // It tells the number of parameters.
        self.restore_survey(state.survey)?;
        self.adam.restore(&state.first, &state.second, state.steps)?;
        self.model.set_parameters(&state.parameters);
        self.parameters = state.parameters;
        self.average = state.average;
        self.usual_norm = state.usual_norm;
        self.held_out_psnr = state.held_out_psnr;
        self.restore_exposures(state.exposures.as_ref())?;
        self.restore_refinement(state.refinement)
    }

    /// Writes the checkpoint and the model files.
    ///
    /// # Errors
    /// If a file cannot be written. The file that was there before then stays complete.
    pub fn save(&self) -> anyhow::Result<()> {
        let (first, second, steps) = self.adam.state();
        let state = State {
            iteration: self.iteration,
            seconds: self.seconds,
            searching: self.searching,
            usual_norm: self.usual_norm,
            held_out_psnr: self.held_out_psnr,
            parameters: self.parameters.clone(),
            average: self.average.clone(),
            first: first.to_vec(),
            second: second.to_vec(),
            steps,
            refinement: self.corrections.state(),
            exposures: self.exposures_state(),
            survey: self.survey.clone(),
        };
        state.save(&checkpoint_path(&self.folder))?;
        self.save_cameras()?;
        self.save_exposures()?;
        self.model.save(&self.folder, self.file.origin())
    }
}
