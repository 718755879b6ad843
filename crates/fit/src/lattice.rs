//! Values of the field on a lattice, with which the rays of a sharp surface skip empty space.

use std::path::Path;

use field::{Field, Sphere};
use files::InputError;
use glam::Vec3;
use rayon::prelude::*;
use trace::Lattice;

use crate::checkpoint::LatticeState;
use crate::model::Model;

/// Iterations from one lattice to the next. Late in a fit of `spot`, an iteration takes 14,400
/// evaluations without a lattice, and 10,100 with one; one in fifteen of these is the lattice's own.
pub(crate) const PERIOD: u64 = 32;

/// Nodes that a thread evaluates at a time.
const CHUNK: usize = 1024;

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
    /// A lattice of the model in a ball, some iterations after the `last` one. The bits do not depend
    /// on the number of threads.
    pub(crate) fn after(last: Option<FieldLattice>, model: &Model, ball: &Sphere<f32>) -> Self {
        Self::of_state(next(model, ball, last.map(|own| own.state)), ball)
    }

    /// The lattice of a checkpoint.
    ///
    /// # Errors
    /// If the number of values is not that of the ball.
    pub(crate) fn restored(
        state: LatticeState,
        ball: &Sphere<f32>,
        checkpoint: &Path,
    ) -> Result<Self, InputError> {
        let (found, expected) = (state.values.len(), Lattice::<f32>::places(ball).len());
        if found != expected {
            let expected = format!("{expected} numbers, according to fit.toml");
            return Err(InputError::new(checkpoint, "lattice", found, expected));
        }
        Ok(Self::of_state(state, ball))
    }

    fn of_state(state: LatticeState, ball: &Sphere<f32>) -> Self {
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
        nodes.par_chunks(CHUNK).flat_map_iter(values).collect::<Vec<f32>>()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::FitOptions;
    use crate::run_file::RunFile;
    use glam::Vec3;

    const BALL: Sphere<f32> = Sphere { center: Vec3::ZERO, radius: 1.0 };

    /// The model before the first iteration: about a ball of this radius.
    fn model(initial_radius: f64) -> Model {
        let options =
            FitOptions { width: 16, layers: 2, bands: 0, initial_radius, ..FitOptions::default() };
        Model::initial(&RunFile::of_test(options))
    }

    #[test]
    fn a_lattice_is_of_use_while_the_field_changes_slowly() {
        let [small, large] = [0.4, 0.7].map(model);
        let first = FieldLattice::after(None, &small, &BALL);
        assert!(first.get().is_none() && first.state.change.is_none());
        let second = FieldLattice::after(Some(first.clone()), &small, &BALL);
        assert!(second.get().is_some());
        assert_eq!(second.state.change, Some(0.0));
        let third = FieldLattice::after(Some(second), &large, &BALL);
        assert!(third.get().is_none());
        assert!((third.state.change.unwrap() - 0.3).abs() < 0.1, "{:?}", third.state.change);
        // Far nodes keep their values until the lattice is of use again.
        let is_far = |f: &f32| f.abs() > NEAR * Lattice::cell(&BALL);
        let kept = first.state.values.iter().zip(&third.state.values);
        assert!(kept.filter(|(f, _)| is_far(f)).all(|(before, after)| before == after));
        let fourth = FieldLattice::after(Some(third), &large, &BALL);
        assert!(fourth.get().is_some());
        assert_eq!(fourth.state.values, FieldLattice::after(None, &large, &BALL).state.values);
    }

    #[test]
    fn a_checkpoint_of_another_size_is_refused() {
        let state = FieldLattice::after(None, &model(0.5), &BALL).state;
        let restored = FieldLattice::restored(state.clone(), &BALL, Path::new("state"));
        assert_eq!(restored.unwrap().state, state);
        let cut = LatticeState { values: state.values[1..].to_vec(), change: None };
        let error = FieldLattice::restored(cut, &BALL, Path::new("state")).unwrap_err();
        assert!(error.to_string().contains("lattice: found 22232, expected 22233"), "{error}");
    }
}
