//! Values of the field on a lattice, with which the rays of a sharp surface skip empty space.

use std::path::Path;

use field::{Field, Sphere};
use files::InputError;
use glam::Vec3;
use loss::schedule::sharpness;
use rayon::prelude::*;
use trace::Lattice;

use crate::checkpoint::LatticeState;
use crate::fit::{Fit, TRACED_CHUNK};
use crate::model::Model;

/// Iterations from one lattice to the next. Late in a fit of `spot`, an iteration takes 14,400
/// evaluations without a lattice, and 10,100 with one; one in fifteen of these is the lattice's own.
const PERIOD: u64 = 32;

/// Nodes with a smaller |f| are near the surface: the change of f counts there. In cells.
const NEAR: f32 = 2.0;

/// The change of f until the next lattice, in units of that since the last one.
const MARGIN: f32 = 1.5;

/// The largest change until the next lattice, in cells: with more, a lattice saves no time. Early in
/// a fit, f changes faster.
const MOST_CHANGE: f32 = 0.5;

/// The values of the field on a lattice, and the lattice if they are of use.
#[derive(Clone, Debug)]
pub(crate) struct FieldLattice {
    pub(crate) state: LatticeState,
    lattice: Option<Lattice<f32>>,
}

impl FieldLattice {
    fn new(state: LatticeState, ball: &Sphere<f32>) -> Self {
        let drift = drift(&state, ball);
        let lattice = drift.map(|drift| Lattice::of_values(ball, &state.values).with_drift(drift));
        FieldLattice { state, lattice }
    }

    /// The lattice for rays, if it is of use.
    pub(crate) fn get(&self) -> Option<&Lattice<f32>> {
        self.lattice.as_ref()
    }
}

/// The change of f until the next lattice, in world units; `None` if it is unknown or too large.
fn drift(state: &LatticeState, ball: &Sphere<f32>) -> Option<f32> {
    let drift = state.change.map(|change| change * MARGIN);
    drift.filter(|drift| *drift < MOST_CHANGE * Lattice::cell(ball))
}

/// The ball of a fit's lattice.
fn ball_of(fit: &Fit) -> Sphere<f32> {
    let bounds = fit.file.sphere();
    Sphere { center: bounds.center.as_vec3(), radius: bounds.radius as f32 }
}

/// Makes a lattice of the field, if it is time. The bits do not depend on the number of threads.
pub(crate) fn refresh_lattice(fit: &mut Fit) {
    let is_sharp = sharpness(fit.progress(), fit.file.options.soft()).is_none();
    if !is_sharp || fit.estimator.reach().is_none() {
        fit.lattice = None;
    } else if fit.clock.iteration.is_multiple_of(PERIOD) || fit.lattice.is_none() {
        let last = fit.lattice.take().map(|own| own.state);
        let ball = ball_of(fit);
        fit.lattice = Some(FieldLattice::new(next(&fit.model, &ball, last), &ball));
    }
}

/// The values of the field now. After those of the `last` time, only nodes near the surface are
/// evaluated, unless the change there is so small that the lattice is of use.
fn next(model: &Model, ball: &Sphere<f32>, last: Option<LatticeState>) -> LatticeState {
    let places = Lattice::<f32>::places(ball);
    let evaluated = |nodes: &[usize]| {
        let values = |nodes: &[usize]| {
            let x: Vec<Vec3> = nodes.iter().map(|node| places[*node]).collect();
            let mut f = vec![0.0; x.len()];
            model.field.value(&x, &mut f);
            f
        };
        nodes.par_chunks(TRACED_CHUNK).flat_map_iter(values).collect::<Vec<f32>>()
    };
    let Some(mut state) = last else {
        let all: Vec<usize> = (0..places.len()).collect();
        return LatticeState { values: evaluated(&all), change: None };
    };
    let nearest = NEAR * Lattice::cell(ball);
    let (near, others): (Vec<usize>, Vec<usize>) =
        (0..places.len()).partition(|node| state.values[*node].abs() < nearest);
    let mut change = 0.0f32;
    for (node, f) in near.iter().zip(evaluated(&near)) {
        change = change.max((f - state.values[*node]).abs());
        state.values[*node] = f;
    }
    state.change = Some(change);
    if drift(&state, ball).is_some() {
        for (node, f) in others.iter().zip(evaluated(&others)) {
            state.values[*node] = f;
        }
    }
    state
}

/// Restores the lattice of a checkpoint.
pub(crate) fn restore_lattice(
    fit: &mut Fit,
    state: Option<LatticeState>,
    checkpoint: &Path,
) -> Result<(), InputError> {
    let Some(state) = state else { return Ok(()) };
    let ball = ball_of(fit);
    let (found, expected) = (state.values.len(), Lattice::<f32>::places(&ball).len());
    if found != expected {
        let expected = format!("{expected} numbers, according to fit.toml");
        return Err(InputError::new(checkpoint, "lattice", found, expected));
    }
    fit.lattice = Some(FieldLattice::new(state, &ball));
    Ok(())
}
