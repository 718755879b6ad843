//! The memory of gradients, which an iteration uses again, and the tasks that threads share.

use rayon::prelude::*;

use crate::drawn::PARTS;
use crate::objective::Objective;
use crate::sums::{PIECE, PartSums, Piece, pieces, sizes};

/// A stage of [`gradient`](crate::gradient()). Threads share the tasks of a stage, and the next
/// stage begins when all are done; but `Deal`, `Reverse` and `Backward` of a sharp surface go on
/// beside `Record`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Sums of zero for all parts.
    Clear,
    /// The terms of a soft surface.
    Soft,
    /// One ray for each pixel.
    Trace,
    /// The records of pixels that a silhouette may cross.
    Record,
    /// Traced pixels without these, dealt to parts: one task.
    Deal,
    /// The reverse mode of each part down to coefficients of f and ∇f at points, without these
    /// records.
    Reverse,
    /// The reverse mode of the records.
    ReverseRecord,
    /// The gradient by the field's parameters of these coefficients.
    Backward,
    /// The sum over the parts.
    Sum,
    /// Loops of the caller: tasks that threads share in equal pieces.
    Caller,
}

/// Gets the stage of each task as the task begins, with `true`, and as it ends, with `false`.
/// Several threads call it.
pub type Observer = Box<dyn Fn(Stage, bool) + Send + Sync>;

/// Working memory of [`gradient`](crate::gradient()), to be used again: an iteration without it
/// has to clear fresh memory for all parameters.
#[derive(Default)]
pub struct Workspace {
    parts: Vec<PartSums>,
    parameters: Vec<f32>,
    observed: Option<(usize, Observer)>,
}

impl std::fmt::Debug for Workspace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let workers = self.observed.as_ref().map(|(workers, _)| workers);
        f.debug_struct("Workspace").field("workers", &workers).finish_non_exhaustive()
    }
}

impl Workspace {
    /// Shares the tasks as for this number of threads, and shows each task to an observer.
    pub fn observed(workers: usize, observer: Observer) -> Self {
        Workspace { observed: Some((workers, observer)), ..Self::default() }
    }

    /// The number of tasks of a stage whose results do not depend on it.
    pub(crate) fn tasks(&self) -> usize {
        let workers =
            self.observed.as_ref().map_or_else(rayon::current_num_threads, |(workers, _)| *workers);
        // On one thread, half of a batch takes no longer than all of it at once.
        workers.clamp(2, PARTS)
    }

    /// Runs a task, and shows it to the observer.
    pub fn run<T>(&self, stage: Stage, task: impl FnOnce() -> T) -> T {
        let show = |begins| {
            if let Some((_, observer)) = &self.observed {
                observer(stage, begins);
            }
        };
        show(true);
        let result = task();
        show(false);
        result
    }

    /// Sums of zero for each part.
    pub(crate) fn take(&mut self, objective: &Objective<'_>) -> Vec<PartSums> {
        let mut sums = std::mem::take(&mut self.parts);
        sums.resize_with(PARTS, PartSums::default);
        sums.par_iter_mut().for_each(|sums| self.run(Stage::Clear, || sums.reset(objective)));
        sums
    }

    /// Zeros for all parameters: of the field, then of the radiance head, then of a trained
    /// background.
    pub(crate) fn zeros(&mut self, objective: &Objective<'_>) -> Vec<f32> {
        let count = sizes(objective).into_iter().map(|(count, _)| count).sum();
        let mut zeros = std::mem::take(&mut self.parameters);
        zeros.resize(count, 0.0);
        zeros.par_chunks_mut(PIECE).for_each(|piece| piece.fill(0.0));
        zeros
    }

    /// Adds the parts to the sum over all parameters, in their order.
    pub(crate) fn add_to(&mut self, total: &mut [f32], parts: Vec<PartSums>) {
        let pieces = pieces(total, &parts[0]);
        let add = |piece: Piece<'_>| self.run(Stage::Sum, || piece.add(&parts));
        pieces.into_par_iter().for_each(add);
        self.parts = parts;
    }

    /// Takes the memory of a gradient back.
    pub fn reuse(&mut self, parameters: Vec<f32>) {
        self.parameters = parameters;
    }
}
