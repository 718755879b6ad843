//! Adam, learning-rate schedules, gradient clipping and finite checks, over plain slices.
//!
//! A *gradient* points uphill: steps go against it. A *group* is a range of parameters with
//! settings of its own. *Progress* is the fraction of a run that is done, from 0 to 1.
//!
//! ```
//! use optim::{Adam, Group, Schedule};
//!
//! // Minimise (x − 3)² + 10 (y + 1)².
//! let mut adam = Adam::<f64>::new(2, vec![Group::new("all", 0..2)]);
//! let schedule = Schedule::WarmUpCosine { warm_up: 0.05, last: 0.01 };
//! let mut p = [0.0, 0.0];
//! for i in 0..1000 {
//!     let gradient = [2.0 * (p[0] - 3.0), 20.0 * (p[1] + 1.0)];
//!     adam.step(&mut p, &gradient, 0.05 * schedule.fraction(i as f64 / 1000.0))?;
//! }
//! assert!((p[0] - 3.0).abs() < 1e-3 && (p[1] + 1.0).abs() < 1e-3);
//! # Ok::<(), optim::OptimError>(())
//! ```
//!
//! # What is guaranteed
//! Everything is elementwise in a fixed order, so the same inputs give the same bits, also from a
//! saved state. A step is taken as a whole or not at all: a gradient or rate that would leave a NaN
//! or an infinity behind is refused.
//!
//! # What is not
//! Parameters are the caller's; that they are finite is not checked.
//!
//! Source: Kingma and Ba, "Adam: A Method for Stochastic Optimization" (2015), algorithm 1;
//! decoupled weight decay from Loshchilov and Hutter (2019).

mod schedule;

use std::ops::Range;

use num_traits::Float;

pub use schedule::{InvalidSchedule, Schedule};

/// A range of parameters with settings of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// A name for messages.
    pub name: String,
    /// The parameters it holds.
    pub range: Range<usize>,
    /// A factor on the learning rate.
    pub rate: f64,
    /// β₁: the decay of the gradient's mean.
    pub beta1: f64,
    /// β₂: the decay of the gradient's mean square.
    pub beta2: f64,
    /// Decoupled weight decay, per unit of learning rate.
    pub weight_decay: f64,
}

impl Group {
    /// A group with the published settings: β₁ = 0.9, β₂ = 0.999, no weight decay.
    pub fn new(name: impl Into<String>, range: Range<usize>) -> Self {
        Group { name: name.into(), range, rate: 1.0, beta1: 0.9, beta2: 0.999, weight_decay: 0.0 }
    }
}

/// The guard in the denominator, as published.
const EPSILON: f64 = 1e-8;

/// Why a step was not taken; parameters and state are as before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptimError {
    /// A gradient that is not a number, or so large that its square overflows. The running mean of
    /// squares would become infinite, and the parameter would never move again.
    #[error("gradient {index} of group {group} is {value}, expected a number with a finite square")]
    NotFinite {
        /// The group's name.
        group: String,
        /// The index in the whole vector.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A learning rate that is not a number.
    #[error("the learning rate of group {group} is {value}, expected a finite number")]
    Rate {
        /// The group's name.
        group: String,
        /// The rate, with the group's factor.
        value: f64,
    },
    /// A saved state that no run leaves behind.
    #[error("{what} {index} is {value}, expected a finite number, and 0 or more for a mean square")]
    State {
        /// Which moments.
        what: &'static str,
        /// The index.
        index: usize,
        /// The value.
        value: f64,
    },
    /// Slices that do not fit together.
    #[error("{what} has length {found}, expected {expected}")]
    Length {
        /// Which slice.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The optimiser's length.
        expected: usize,
    },
}

/// The optimiser's state: running means of gradient and squared gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam<R> {
    groups: Vec<Group>,
    first: Vec<R>,
    second: Vec<R>,
    steps: u64,
}

fn constant<R: Float>(value: f64) -> R {
    R::from(value).unwrap_or_else(R::nan)
}

impl<R: Float> Adam<R> {
    /// A fresh optimiser of `length` parameters; those in no group stay as they are.
    ///
    /// # Panics
    /// If a group reaches beyond the parameters or overlaps another, or a β is not in [0, 1).
    pub fn new(length: usize, groups: Vec<Group>) -> Self {
        let mut ranges: Vec<&Range<usize>> =
            groups.iter().map(|g| &g.range).filter(|r| !r.is_empty()).collect();
        ranges.sort_by_key(|r| r.start);
        assert!(
            ranges.iter().all(|r| r.end <= length),
            "groups within {length} parameters, not {ranges:?}"
        );
        assert!(
            ranges.windows(2).all(|w| w[0].end <= w[1].start),
            "groups that do not overlap, not {ranges:?}"
        );
        for group in &groups {
            for beta in [group.beta1, group.beta2] {
                assert!(
                    (0.0..1.0).contains(&beta),
                    "decay {beta} of group {}, expected from 0 to below 1",
                    group.name
                );
            }
        }
        Adam { groups, first: vec![R::zero(); length], second: vec![R::zero(); length], steps: 0 }
    }

    /// One step against `gradient` with learning rate `rate`.
    ///
    /// # Errors
    /// If a gradient, its square or the rate is not finite, or a length is wrong; nothing has
    /// changed then.
    pub fn step(
        &mut self,
        parameters: &mut [R],
        gradient: &[R],
        rate: R,
    ) -> Result<(), OptimError> {
        self.check_length("parameters", parameters.len())?;
        self.check_length("gradient", gradient.len())?;
        self.groups.iter().try_for_each(|group| check_group(group, gradient, rate))?;
        self.steps += 1;
        let exponent = i32::try_from(self.steps).unwrap_or(i32::MAX);
        for group in &self.groups {
            let (beta1, beta2) = (constant::<R>(group.beta1), constant::<R>(group.beta2));
            // Differences from 1 in double precision: in single they lose four digits.
            let (fresh1, fresh2) =
                (constant::<R>(1.0 - group.beta1), constant::<R>(1.0 - group.beta2));
            let unbias1 = constant::<R>(1.0 - group.beta1.powi(exponent));
            let unbias2 = constant::<R>(1.0 - group.beta2.powi(exponent));
            let (rate, epsilon) = (rate * constant(group.rate), constant::<R>(EPSILON));
            let decay = rate * constant(group.weight_decay);
            for i in group.range.clone() {
                let g = gradient[i];
                let m = beta1 * self.first[i] + fresh1 * g;
                let v = beta2 * self.second[i] + fresh2 * (g * g);
                (self.first[i], self.second[i]) = (m, v);
                let step = rate * (m / unbias1) / ((v / unbias2).sqrt() + epsilon);
                parameters[i] = parameters[i] - step - decay * parameters[i];
            }
        }
        Ok(())
    }

    fn check_length(&self, what: &'static str, found: usize) -> Result<(), OptimError> {
        let expected = self.first.len();
        if found == expected { Ok(()) } else { Err(OptimError::Length { what, found, expected }) }
    }

    /// The running means of gradient and squared gradient, and the number of steps: all there is to
    /// save.
    pub fn state(&self) -> (&[R], &[R], u64) {
        (&self.first, &self.second, self.steps)
    }

    /// Goes on from a saved state, bit for bit.
    ///
    /// # Errors
    /// If a length is wrong, a number is not finite or a mean square is negative; nothing has
    /// changed then.
    pub fn restore(&mut self, first: &[R], second: &[R], steps: u64) -> Result<(), OptimError> {
        self.check_length("first moments", first.len())?;
        self.check_length("second moments", second.len())?;
        check_moments("mean gradient", first, R::neg_infinity())?;
        check_moments("mean square gradient", second, R::zero())?;
        self.first.copy_from_slice(first);
        self.second.copy_from_slice(second);
        self.steps = steps;
        Ok(())
    }
}

fn double<R: Float>(value: R) -> f64 {
    value.to_f64().unwrap_or(f64::NAN)
}

/// Refuses a step of this group that would leave a NaN or an infinity behind.
fn check_group<R: Float>(group: &Group, gradient: &[R], rate: R) -> Result<(), OptimError> {
    let own = &gradient[group.range.clone()];
    if let Some(at) = own.iter().position(|&g| !(g * g).is_finite()) {
        let (name, index) = (group.name.clone(), group.range.start + at);
        return Err(OptimError::NotFinite { group: name, index, value: double(own[at]) });
    }
    let rate = rate * constant(group.rate);
    if rate.is_finite() {
        Ok(())
    } else {
        Err(OptimError::Rate { group: group.name.clone(), value: double(rate) })
    }
}

fn check_moments<R: Float>(what: &'static str, values: &[R], least: R) -> Result<(), OptimError> {
    match values.iter().position(|v| !v.is_finite() || *v < least) {
        Some(index) => Err(OptimError::State { what, index, value: double(values[index]) }),
        None => Ok(()),
    }
}

/// The first number that is infinite or NaN, with its index.
pub fn first_non_finite<R: Float>(values: &[R]) -> Option<(usize, R)> {
    values.iter().position(|v| !v.is_finite()).map(|i| (i, values[i]))
}

/// The Euclidean norm, summed in order and scaled so that it neither over- nor underflows.
pub fn norm<R: Float>(values: &[R]) -> R {
    let largest =
        values.iter().fold(R::zero(), |m, v| if v.abs() > m || v.is_nan() { v.abs() } else { m });
    if largest == R::zero() || !largest.is_finite() {
        return largest;
    }
    let sum = values.iter().fold(R::zero(), |s, v| s + (*v / largest) * (*v / largest));
    largest * sum.sqrt()
}

/// Shortens a gradient to norm `most` if it is longer; returns the norm it had. A gradient that is
/// not finite is left.
pub fn clip_norm<R: Float>(gradient: &mut [R], most: R) -> R {
    let length = norm(gradient);
    if length > most && length.is_finite() {
        let factor = most / length;
        gradient.iter_mut().for_each(|g| *g = *g * factor);
    }
    length
}

#[cfg(test)]
mod tests;
