//! The optimiser of a fit: Adam and Muon, a clipped gradient, and a mean of the parameters at the end.
//!
//! The mean over the last part of a fit: Polyak and Juditsky, "Acceleration of Stochastic
//! Approximation by Averaging", SIAM Journal on Control and Optimization 30(4), 1992. Steps with
//! random pixels lead around an optimum; the mean of the positions is nearer to it than the last
//! one.

use std::borrow::Cow;

use loss::schedule::is_averaged;
use optim::{Adam, OptimError};
use rayon::prelude::*;
use sdf_nn::background::Volume;

use crate::checkpoint::{Average, OptimiserState};
use crate::model::{MATRICES_GROUP, MATRIX_RATE, Model, NETWORK_GROUP};
use crate::options::FitOptions;

/// The weight of an iteration in the running mean of the gradient's norm. At 0.02 and 0.15:
/// distance 1.05 and 1.01 (see the evidence in the module `loss::schedule`).
const NORM_WEIGHT: f32 = 0.05;

/// The share of the largest step of a background's feature that smoothing by one neighbour undoes.
const SMOOTHNESS: f64 = 0.2;

/// Iterations from one smoothing to the next, each of which goes through all features.
const SMOOTH_EVERY: u64 = 4;

/// The number of parameters that a thread takes at a time.
const PIECE: usize = 1 << 14;

/// The optimiser of a fit, with the parameters.
#[derive(Debug)]
pub(crate) struct Optimiser {
    adam: Adam<f32>,
    parameters: Vec<f32>,
    /// The mean of the parameters over the last part of the budget.
    average: Option<Average>,
    /// The running mean of the gradient's norm; 0 before the first step.
    usual_norm: f32,
}

impl Optimiser {
    /// The optimiser of a model before its first step.
    pub(crate) fn new(model: &Model) -> Self {
        let parameters = model.parameters();
        let adam = Adam::new(parameters.len(), model.groups());
        Optimiser { adam, parameters, average: None, usual_norm: 0.0 }
    }

    /// Takes a step of the model against the gradient; `iteration` and `progress` are those before
    /// the step, and `schedule` is the fraction of the learning rate. The network of the field can
    /// have a smaller one. Returns the norm of the gradient before clipping.
    pub(crate) fn step(
        &mut self,
        model: &mut Model,
        gradient: &mut [f32],
        options: &FitOptions,
        StepTime { iteration, progress, schedule }: StepTime,
    ) -> Result<f32, OptimError> {
        let background = model.background.parameters().len();
        let shape = gradient.len() - background;
        let norm = self.clip(&mut gradient[..shape], options.clip as f32);

        let rate = options.learning_rate() * schedule;
        let of_network = options.network_rate(progress);
        self.adam.set_rate(NETWORK_GROUP, of_network);
        if model.matrices_of_field().next().is_some() {
            self.adam.set_rate(MATRICES_GROUP, MATRIX_RATE * of_network);
        }
        self.adam.step(&mut self.parameters, gradient, rate as f32)?;

        if background > 0 && iteration.is_multiple_of(SMOOTH_EVERY) {
            let step = SMOOTHNESS * SMOOTH_EVERY as f64 * rate;
            Volume::smooth(&mut self.parameters[shape..], step as f32);
        }
        model.set_parameters(&self.parameters);
        self.add_to_average(progress);
        Ok(norm)
    }

    /// Clips the gradient of the field and the radiance head to a multiple of the running mean of
    /// its norm, updates the running mean, and returns the norm before clipping. The first gradient
    /// is not clipped.
    fn clip(&mut self, gradient: &mut [f32], multiple: f32) -> f32 {
        let known = self.usual_norm > 0.0;
        let limit = multiple * self.usual_norm;
        let norm = optim::clip_norm(gradient, if known { limit } else { f32::MAX });
        let kept = norm.min(if known { limit } else { norm });
        let weight = if known { NORM_WEIGHT } else { 1.0 };
        self.usual_norm += weight * (kept - self.usual_norm);
        norm
    }

    /// Adds the parameters after a step to their mean, in the last part of the budget.
    fn add_to_average(&mut self, progress: f64) {
        if !is_averaged(progress) {
            // A longer budget puts the run back.
            self.average = None;
            return;
        }
        let count = self.parameters.len();
        let Average { parameters, steps } =
            self.average.get_or_insert_with(|| Average { parameters: vec![0.0; count], steps: 0 });
        *steps += 1;
        let weight = 1.0 / *steps as f32;
        parameters.par_chunks_mut(PIECE).zip(self.parameters.par_chunks(PIECE)).for_each(
            |(mean, own)| mean.iter_mut().zip(own).for_each(|(a, p)| *a += weight * (*p - *a)),
        );
    }

    /// Takes the mean as the model, if there is one.
    pub(crate) fn take_average(&self, model: &mut Model) {
        if let Some(average) = &self.average {
            model.set_parameters(&average.parameters);
        }
    }

    /// Frees these nodes of the fine levels of the model's grid, and no others. Coefficients and
    /// moments of nodes that stay free are kept.
    pub(crate) fn free_nodes(
        &mut self,
        model: &mut Model,
        is_free: &[bool],
    ) -> Result<(), OptimError> {
        if is_free.is_empty() {
            return Ok(());
        }
        let before = model.field.splines().clone();
        let weights = model.field.weight_count();
        let old = weights + before.free_count();
        model.set_fine_nodes(is_free);

        let after = model.field.splines();
        let moved = |all: &[f32]| {
            let mut table = after.table();
            before.expand(&all[weights..old], &mut table);
            [&all[..weights], &after.gather(&table), &all[old..]].concat()
        };
        let (first, second, steps) = self.adam.state();
        let (first, second) = (moved(first), moved(second));
        self.parameters = model.parameters();
        self.adam = Adam::new(self.parameters.len(), model.groups());
        self.adam.restore(&first, &second, steps)?;
        self.average = None;
        Ok(())
    }

    /// The state, for a checkpoint.
    pub(crate) fn state(&self) -> OptimiserState<'_> {
        let (first, second, steps) = self.adam.state();
        OptimiserState {
            parameters: self.parameters.as_slice().into(),
            average: self.average.as_ref().map(Cow::Borrowed),
            first: first.into(),
            second: second.into(),
            steps,
            usual_norm: self.usual_norm,
        }
    }

    /// Restores the state of a checkpoint. The free nodes of the model must be those of the state.
    pub(crate) fn restore(
        &mut self,
        model: &mut Model,
        state: OptimiserState<'_>,
    ) -> Result<(), OptimError> {
        self.adam.restore(&state.first, &state.second, state.steps)?;
        model.set_parameters(&state.parameters);
        self.parameters = state.parameters.into_owned();
        self.average = state.average.map(Cow::into_owned);
        self.usual_norm = state.usual_norm;
        Ok(())
    }
}

/// The time of a step in its fit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepTime {
    /// The number of finished iterations.
    pub(crate) iteration: u64,
    /// The spent fraction of the budget.
    pub(crate) progress: f64,
    /// The learning rate as a fraction of the largest.
    pub(crate) schedule: f64,
}
