//! The sums of the parts of a batch, and their sum.

use std::ops::Range;

use field::{Additions, PartialSum};
use rayon::prelude::*;
use render::Scene;

use crate::batch::Batch;
use crate::gradient::PARTS;

/// The gradient of a part by the parameters.
#[derive(Debug, Default)]
pub(crate) struct PartSums {
    /// By those of the field.
    pub(crate) field: PartialSum<f32>,
    /// By those of the radiance head.
    pub(crate) shader: PartialSum<f32>,
    /// By those of a trained background.
    pub(crate) background: PartialSum<f32>,
}

impl PartSums {
    /// Becomes zero, for the parameters of a batch.
    fn reset(&mut self, batch: &Batch<'_>) {
        let sums = [&mut self.field, &mut self.shader, &mut self.background];
        sums.into_iter()
            .zip(sizes(batch))
            .for_each(|(sum, (count, table))| sum.reset(count, table));
    }
}

/// The number of parameters, and the place of the table among them: of the field, then of the
/// radiance head, then of a trained background.
fn sizes(batch: &Batch<'_>) -> [(usize, Range<usize>); 3] {
    let Scene { field, shader, background, .. } = &batch.scene;
    let trained = (background.parameter_count(), background.table());
    [
        (field.parameter_count(), field.table()),
        (shader.parameter_count(), shader.table()),
        if batch.trains_background { trained } else { (0, 0..0) },
    ]
}

/// The partial sum of a part by the parameters of one object.
type OfPart = fn(&PartSums) -> &PartialSum<f32>;

/// The objects with parameters, in their order.
const OBJECTS: [OfPart; 3] = [|part| &part.field, |part| &part.shader, |part| &part.background];

/// Parameters outside of tables that a thread adds up at a time.
const PIECE: usize = 1 << 12;

/// A piece of the sum over all parts.
struct Piece<'a> {
    total: &'a mut [f32],
    of_part: OfPart,
    terms: Terms,
}

/// The terms of a piece in each part.
#[derive(Clone, Copy)]
enum Terms {
    /// The sums outside of the table, from this one on.
    Others(usize),
    /// The additions of this bin.
    Bin(usize),
}

impl Piece<'_> {
    /// Adds the parts up, in their order.
    fn add(self, parts: &[PartSums]) {
        let Piece { total, of_part, terms } = self;
        for part in parts.iter().map(of_part) {
            match terms {
                Terms::Others(first) => {
                    let own = &part.others[first..first + total.len()];
                    total.iter_mut().zip(own).for_each(|(sum, own)| *sum += *own);
                }
                Terms::Bin(bin) => part.table.add_bin(bin, total),
            }
        }
    }
}

/// The pieces of the sum over all parts, of which `part` is one.
fn pieces<'a>(mut total: &'a mut [f32], part: &PartSums) -> Vec<Piece<'a>> {
    let mut pieces = Vec::new();
    for of_part in OBJECTS {
        let (others, place) = (of_part(part).others.len(), of_part(part).place());
        let (before, rest) = total.split_at_mut(place.start);
        let (table, rest) = rest.split_at_mut(place.len());
        let (after, rest) = rest.split_at_mut(others - place.start);
        for (first, own) in [(0, before), (place.start, after)] {
            pieces.extend(own.chunks_mut(PIECE).enumerate().map(|(i, total)| Piece {
                total,
                of_part,
                terms: Terms::Others(first + i * PIECE),
            }));
        }
        let bins = table.chunks_mut(Additions::<f32>::BIN).enumerate();
        pieces.extend(bins.map(|(bin, total)| Piece { total, of_part, terms: Terms::Bin(bin) }));
        total = rest;
    }
    pieces
}

/// A stage of [`gradient`](crate::gradient()). Threads share the tasks of a stage, and the next
/// stage begins when all are done.
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
    /// The reverse mode of each part down to coefficients of f and ∇f at points.
    Reverse,
    /// The gradient by the field's parameters of these coefficients.
    Backward,
    /// The sum over the parts.
    Sum,
    /// The caller's loops over all parameters: one task, which threads share in equal pieces.
    Parameters,
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
    pub(crate) fn take(&mut self, batch: &Batch<'_>) -> Vec<PartSums> {
        let mut sums = std::mem::take(&mut self.parts);
        sums.resize_with(PARTS, PartSums::default);
        sums.par_iter_mut().for_each(|sums| self.run(Stage::Clear, || sums.reset(batch)));
        sums
    }

    /// Zeros for all parameters: of the field, then of the radiance head, then of a trained
    /// background.
    pub(crate) fn zeros(&mut self, batch: &Batch<'_>) -> Vec<f32> {
        let count = sizes(batch).into_iter().map(|(count, _)| count).sum();
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
