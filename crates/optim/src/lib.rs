#![doc = include_str!("../README.md")]

mod group;
mod muon;
mod schedule;

use std::ops::Range;

use ndarray::LinalgScalar;
use num_traits::Float;
use rayon::prelude::*;

use group::constant;

pub use group::Group;
pub use schedule::{InvalidSchedule, Schedule};

/// ε in the denominator of a step, in units of the gradient: the value that Kingma and Ba suggest.
const EPSILON: f64 = 1e-8;

/// The reason why a step or a saved state was refused. Parameters and optimiser are unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptimError {
    /// A gradient is a NaN or infinite, or its square overflows. The running mean of squares would
    /// become infinite, and the parameter would never move again.
    #[error("gradient {index} of group {group} is {value}, expected a number with a finite square")]
    NotFinite {
        /// The name of the group.
        group: String,
        /// The index in the whole gradient.
        index: usize,
        /// The gradient.
        value: f64,
    },
    /// A learning rate is a NaN or infinite.
    #[error("the learning rate of group {group} is {value}, expected a finite number")]
    Rate {
        /// The name of the group.
        group: String,
        /// The rate times the factor of the group.
        value: f64,
    },
    /// A saved state holds a number that no run can produce.
    #[error("{what} {index} is {value}, expected a finite number, and 0 or more for a mean square")]
    State {
        /// The name of the moments.
        what: &'static str,
        /// The index of the parameter.
        index: usize,
        /// The number.
        value: f64,
    },
    /// A slice has the wrong length.
    #[error("{what} has length {found}, expected {expected}")]
    Length {
        /// The name of the slice.
        what: &'static str,
        /// The length of the slice.
        found: usize,
        /// The number of parameters of the optimiser.
        expected: usize,
    },
}

/// Adam (Kingma and Ba, "Adam: A Method for Stochastic Optimization", ICLR 2015, algorithm 1) with
/// decoupled weight decay (Loshchilov and Hutter, "Decoupled Weight Decay Regularization", ICLR
/// 2019), and Muon for groups that are matrices ([`Group::matrix`]).
///
/// Holds the running means of the gradient and of its square, and the number of steps. The
/// parameters are the caller's.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam<R> {
    groups: Vec<Group>,
    first: Vec<R>,
    second: Vec<R>,
    steps: u64,
}

/// The number of parameters that a thread takes at a time.
const PART: usize = 1 << 14;

/// A step of a group: the numbers that its parameters have in common.
struct Step<R> {
    beta: [R; 2],
    /// 1 − β.
    fresh: [R; 2],
    /// The factor on the mean gradient: the learning rate over its bias.
    rate: R,
    /// The factor on the root of the mean square: one over the root of its bias.
    unbias: R,
    epsilon: R,
    decay: R,
}

/// The number, or zero where it is so small that a smaller one could be subnormal.
///
/// The moments of a parameter without a gradient fall by a factor per step. Rounding stops them at
/// a subnormal number, where arithmetic takes a hundred times as long, for the rest of a run. The
/// steps of such moments are far below ε.
fn normal<R: Float>(moment: R) -> R {
    if moment.abs() < R::min_positive_value() / R::epsilon() { R::zero() } else { moment }
}

impl<R: Float + Send + Sync> Step<R> {
    /// The step number `exponent` with the learning rate `rate` before the group's factor.
    fn new(group: &Group, rate: R, exponent: i32) -> Self {
        let betas = [group.beta1, group.beta2];
        // 1 − β in double precision: in single precision it would lose four digits.
        let [bias1, bias2] = betas.map(|beta| 1.0 - beta.powi(exponent));
        let rate = rate * constant(group.rate);
        Step {
            beta: betas.map(constant),
            fresh: betas.map(|beta| constant(1.0 - beta)),
            rate: rate / constant(bias1),
            unbias: constant(1.0 / bias2.sqrt()),
            epsilon: constant(EPSILON),
            decay: rate * constant(group.weight_decay),
        }
    }

    /// Sets ε to `floor` times the root mean square gradient, from the second moments before the
    /// step.
    fn raise(&mut self, floor: f64, second: &[R]) {
        let count = R::from(second.len().max(1)).unwrap_or_else(R::one);
        let typical = (long_sum(second, |v| v) / count).sqrt() * self.unbias;
        self.epsilon = self.epsilon.max(constant::<R>(floor) * typical);
    }

    /// Takes the step for parameters p with the gradient g and the moments m and v. The slices have
    /// one length; the compiler makes vector code of the loop.
    fn take(&self, p: &mut [R], g: &[R], m: &mut [R], v: &mut [R]) {
        let n = p.len();
        let (g, m, v) = (&g[..n], &mut m[..n], &mut v[..n]);
        for i in 0..n {
            m[i] = normal(self.beta[0] * m[i] + self.fresh[0] * g[i]);
            v[i] = normal(self.beta[1] * v[i] + self.fresh[1] * (g[i] * g[i]));
            let step = self.rate * m[i] / (v[i].sqrt() * self.unbias + self.epsilon);
            p[i] = p[i] - step - self.decay * p[i];
        }
    }
}

impl<R: Float + LinalgScalar + Send + Sync> Adam<R> {
    /// A new optimiser of `length` parameters. Parameters in no group never change.
    ///
    /// # Panics
    /// If a group reaches beyond the parameters or overlaps another, a β is not in [0, 1), or the
    /// columns of a matrix do not divide its length.
    pub fn new(length: usize, groups: Vec<Group>) -> Self {
        assert_groups(length, &groups);
        Adam { groups, first: vec![R::zero(); length], second: vec![R::zero(); length], steps: 0 }
    }

    /// One step against `gradient` with the learning rate `rate`, in units of the parameters.
    ///
    /// # Errors
    /// If a gradient, its square or a rate is not finite, or if a length is wrong. Nothing has
    /// changed then.
    pub fn step(
        &mut self,
        parameters: &mut [R],
        gradient: &[R],
        rate: R,
    ) -> Result<(), OptimError> {
        self.check_length("parameters", parameters.len())?;
        self.check_length("gradient", gradient.len())?;
        let exponent = i32::try_from(self.steps + 1).unwrap_or(i32::MAX);
        let check = |group| check_group(group, gradient, rate, exponent);
        self.groups.iter().try_for_each(check)?;
        self.steps += 1;
        self.step_matrices(parameters, gradient, rate);
        for group in self.groups.iter().filter(|group| group.columns.is_none()) {
            let (mut step, range) = (Step::new(group, rate, exponent), group.range.clone());
            if group.floor > 0.0 {
                step.raise(group.floor, &self.second[range.clone()]);
            }
            let moments = self.first[range.clone()]
                .par_chunks_mut(PART)
                .zip(self.second[range.clone()].par_chunks_mut(PART));
            let pairs = parameters[range.clone()]
                .par_chunks_mut(PART)
                .zip(gradient[range].par_chunks(PART));
            pairs.zip(moments).for_each(|((p, g), (m, v))| step.take(p, g, m, v));
        }
        Ok(())
    }

    /// Takes the steps of the groups that are matrices, each on a thread of its own.
    fn step_matrices(&mut self, parameters: &mut [R], gradient: &[R], rate: R) {
        let mut matrices: Vec<(&Group, usize)> =
            self.groups.iter().filter_map(|group| Some((group, group.columns?))).collect();
        matrices.sort_by_key(|(group, _)| group.range.start);
        let (mut p_rest, mut m_rest, mut at) = (parameters, self.first.as_mut_slice(), 0);
        let mut tasks = Vec::with_capacity(matrices.len());
        for (group, columns) in matrices {
            let Range { start, end } = group.range;
            let (p, p_after) = p_rest.split_at_mut(end - at);
            let (m, m_after) = m_rest.split_at_mut(end - at);
            let (p, m) = (&mut p[start - at..], &mut m[start - at..]);
            tasks.push((group, columns, p, (&gradient[start..end], m)));
            (p_rest, m_rest, at) = (p_after, m_after, end);
        }
        tasks
            .into_par_iter()
            .for_each(|(group, columns, p, moments)| muon::step(group, columns, rate, p, moments));
    }

    /// Sets the factor of the groups of this name on the learning rates of the steps to come. It is
    /// no part of the state.
    ///
    /// # Panics
    /// If there is no group of this name.
    pub fn set_rate(&mut self, name: &str, rate: f64) {
        let mut own = self.groups.iter_mut().filter(|group| group.name == name).peekable();
        assert!(own.peek().is_some(), "no group {name}");
        own.for_each(|group| group.rate = rate);
    }

    fn check_length(&self, what: &'static str, found: usize) -> Result<(), OptimError> {
        let expected = self.first.len();
        if found == expected { Ok(()) } else { Err(OptimError::Length { what, found, expected }) }
    }

    /// The running means of the gradient and of its square (0 in a matrix), one element per
    /// parameter, and the number of steps. A run can continue from these and the parameters.
    pub fn state(&self) -> (&[R], &[R], u64) {
        (&self.first, &self.second, self.steps)
    }

    /// Restores the state that [`state`](Self::state) returned. The following steps then have the
    /// same bits as without the interruption, with the same groups and rates.
    ///
    /// # Errors
    /// If a length is wrong, a number is not finite or a mean square is negative. Nothing has
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

/// Panics if a group reaches beyond `length` or overlaps another, or if a β is not in [0, 1).
fn assert_groups(length: usize, groups: &[Group]) {
    let mut ranges: Vec<&Range<usize>> =
        groups.iter().map(|g| &g.range).filter(|r| !r.is_empty()).collect();
    ranges.sort_by_key(|r| r.start);
    assert!(
        ranges.iter().all(|r| r.end <= length),
        "groups {ranges:?} reach beyond the {length} parameters"
    );
    assert!(ranges.windows(2).all(|w| w[0].end <= w[1].start), "groups {ranges:?} overlap");
    for group in groups {
        if let Some(columns) = group.columns {
            assert!(
                columns > 0 && group.range.len().is_multiple_of(columns),
                "{columns} columns of a matrix of {} parameters, {}",
                group.range.len(),
                group.name
            );
        }
        for beta in [group.beta1, group.beta2] {
            assert!(
                (0.0..1.0).contains(&beta),
                "decay {beta} of group {}, expected a number from 0 to below 1",
                group.name
            );
        }
    }
}

/// Refuses a step if a gradient of this group, its square, or the rate over the bias of the mean is
/// not finite.
fn check_group<R: Float + Send + Sync>(
    group: &Group,
    gradient: &[R],
    rate: R,
    exponent: i32,
) -> Result<(), OptimError> {
    let own = &gradient[group.range.clone()];
    let is_finite = |g: &R| (*g * *g).is_finite();
    // Without an early end, the check of a part is vector code.
    let all_finite = |part: &[R]| part.iter().fold(true, |all, g| all & is_finite(g));
    let part = own.par_chunks(PART).position_first(|part| !all_finite(part));
    let wrong = |part| own[PART * part..].iter().position(|g| !is_finite(g));
    if let Some(at) = part.and_then(|part| Some(PART * part + wrong(part)?)) {
        let (name, index) = (group.name.clone(), group.range.start + at);
        return Err(OptimError::NotFinite { group: name, index, value: double(own[at]) });
    }
    let is_finite = Step::new(group, rate, exponent).rate.is_finite();
    let rate = rate * constant(group.rate);
    if is_finite {
        Ok(())
    } else {
        Err(OptimError::Rate { group: group.name.clone(), value: double(rate) })
    }
}

/// Refuses moments that are not finite or below `least`.
fn check_moments<R: Float>(what: &'static str, values: &[R], least: R) -> Result<(), OptimError> {
    match values.iter().position(|v| !v.is_finite() || *v < least) {
        Some(index) => Err(OptimError::State { what, index, value: double(values[index]) }),
        None => Ok(()),
    }
}

/// The index and the value of the first number that is a NaN or infinite.
pub fn first_non_finite<R: Float>(values: &[R]) -> Option<(usize, R)> {
    values.iter().position(|v| !v.is_finite()).map(|i| (i, values[i]))
}

/// Partial sums of squares: as many as vector registers hold at once.
const SUMS: usize = 16;

/// The sum of f of each value, in [`SUMS`] interleaved partial sums.
fn sum_of<R: Float>(values: &[R], f: impl Fn(R) -> R) -> R {
    let mut sums = [R::zero(); SUMS];
    let (rows, rest) = values.as_chunks::<SUMS>();
    for row in rows {
        for (sum, v) in sums.iter_mut().zip(row) {
            *sum = *sum + f(*v);
        }
    }
    sums.iter_mut().zip(rest).for_each(|(sum, v)| *sum = *sum + f(*v));
    sums.into_iter().fold(R::zero(), |all, sum| all + sum)
}

/// The sum of f of each value: the sums of parts of a fixed length, added in order.
fn long_sum<R: Float + Send + Sync>(values: &[R], f: impl Fn(R) -> R + Sync) -> R {
    let parts: Vec<R> = values.par_chunks(PART).map(|part| sum_of(part, &f)).collect();
    parts.into_iter().fold(R::zero(), |all, sum| all + sum)
}

/// The Euclidean norm, summed in a fixed order. Where squares would overflow or underflow, values
/// are divided by the largest one first. A NaN or an infinity in the slice gives a norm that is not
/// finite.
pub fn norm<R: Float + Send + Sync>(values: &[R]) -> R {
    let sum = long_sum(values, |v| v * v);
    if sum.is_finite() && sum > R::min_positive_value() / R::epsilon() {
        return sum.sqrt();
    }
    let largest =
        values.iter().fold(R::zero(), |m, v| if v.abs() > m || v.is_nan() { v.abs() } else { m });
    if largest == R::zero() || !largest.is_finite() {
        return largest;
    }
    let sum = values.iter().fold(R::zero(), |s, v| s + (*v / largest) * (*v / largest));
    largest * sum.sqrt()
}

/// Scales a gradient to norm `most` if its norm is larger, and returns the norm before (gradient
/// norm clipping: Pascanu, Mikolov and Bengio, "On the difficulty of training recurrent neural
/// networks", ICML 2013). A gradient whose norm is not finite stays unchanged.
pub fn clip_norm<R: Float + Send + Sync>(gradient: &mut [R], most: R) -> R {
    let length = norm(gradient);
    if length > most && length.is_finite() {
        let factor = most / length;
        let scale = |part: &mut [R]| part.iter_mut().for_each(|g| *g = *g * factor);
        gradient.par_chunks_mut(PART).for_each(scale);
    }
    length
}

#[cfg(test)]
mod tests;
