//! The quadrature weights of one ray's points, kept as logarithms until only ratios are left.

use field::{Real, Vector3};

use crate::{Options, WarpedRay};

/// The weights of one ray.
#[derive(Clone, Debug, Default)]
pub struct Weights<R> {
    /// The indices of the points that keep a weight other than zero, in order along the ray.
    pub kept: Vec<usize>,
    /// Their normalised weights ŵ, which sum to 1.
    pub weight: Vec<R>,
    /// For each kept point its share before the shift: w_i/Σ, so that ∂ŵ_i = share_i ∂ln w_i − … (see [`Weights::derivative`]).
    share: Vec<R>,
    /// The point with the smallest kept weight, which all others are shifted by, and its share.
    floor: Option<(usize, R)>,
    /// Whether the weights tie, so that they are taken as constants.
    tied: bool,
}

/// ln w = −γ ln S + ln Δ of a point; −∞ for a point that stands for no length.
fn log_weight<R: Real>(options: &Options<R>, ray: &WarpedRay<'_, R>, i: usize) -> R {
    -options.gamma * spread(options, ray, i).ln() + ray.step[i].ln()
}

/// S = |f| + λ_d |∇f·d| + ε, kept away from zero: ln 0 would be infinite.
pub(crate) fn spread<R: Real>(options: &Options<R>, ray: &WarpedRay<'_, R>, i: usize) -> R {
    let facing = ray.gradient[i].dot(ray.direction).abs();
    (ray.f[i].abs() + options.lambda_d * facing + options.epsilon).max(R::min_positive_value())
}

/// The normalised weights of a ray's points: the k largest, less the smallest of those.
///
/// Where k is not below the number of points nothing can change places, and the weights are taken as they are. If the
/// kept weights all tie, the shift leaves nothing: the tied points then share the weight evenly. They are one point in
/// practice, a root that the recursion has converged on.
pub fn weights<R: Real>(options: &Options<R>, ray: &WarpedRay<'_, R>) -> Weights<R> {
    let n = ray.t.len();
    let log: Vec<R> = (0..n).map(|i| log_weight(options, ray, i)).collect();
    let mut order: Vec<usize> = (0..n).filter(|&i| log[i] > R::neg_infinity()).collect();
    // Largest first; ties by position, so that the order is the same on every machine.
    order.sort_by(|&a, &b| log[b].partial_cmp(&log[a]).unwrap_or(std::cmp::Ordering::Equal).then(a.cmp(&b)));
    let Some(&first) = order.first() else { return Weights::default() };
    let shifted = options.k < n;
    // With fewer weights than k above zero the smallest of the k is a zero, and the shift is by nothing.
    let floor = if shifted && order.len() >= options.k { Some(order[options.k - 1]) } else { None };
    order.truncate(options.k);
    order.sort_unstable();
    let ratio: Vec<R> = order.iter().map(|&i| (log[i] - log[first]).exp()).collect();
    let lowest = floor.map_or(R::zero(), |i| (log[i] - log[first]).exp());
    let sum = ratio.iter().fold(R::zero(), |sum, r| sum + (*r - lowest));
    if sum <= R::zero() {
        let even = R::one() / R::of(order.len() as f64);
        let weight = vec![even; order.len()];
        return Weights { share: weight.clone(), weight, kept: order, floor: None, tied: true };
    }
    let mut out = Weights { floor: floor.map(|i| (i, lowest / sum)), ..Weights::default() };
    for (&i, r) in order.iter().zip(ratio) {
        if r > lowest {
            out.kept.push(i);
            out.weight.push((r - lowest) / sum);
            out.share.push(r / sum);
        }
    }
    out
}

impl<R: Real> Weights<R> {
    /// The derivative of every kept weight, given that of ln w of any point.
    ///
    /// With shares p_i = w_i/Σ and p_0 that of the smallest kept: ŵ_i = p_i − p_0, and Σ changes with all of them, so
    /// ∂ŵ_i = p_i ∂ln w_i − p_0 ∂ln w_0 − ŵ_i Σ_j (p_j ∂ln w_j − p_0 ∂ln w_0).
    pub fn derivative(&self, log_derivative: impl Fn(usize) -> R, out: &mut Vec<R>) {
        out.clear();
        if self.tied {
            out.resize(self.kept.len(), R::zero());
            return;
        }
        let floor = self
            .floor
            .map_or(R::zero(), |(i, share)| if share > R::zero() { share * log_derivative(i) } else { R::zero() });
        out.extend(self.kept.iter().zip(&self.share).map(|(&i, share)| *share * log_derivative(i) - floor));
        let total = out.iter().fold(R::zero(), |sum, d| sum + *d);
        for (d, weight) in out.iter_mut().zip(&self.weight) {
            *d -= *weight * total;
        }
    }

    /// The points whose ln w has to be differentiated: the kept ones and the smallest.
    pub(crate) fn floor_index(&self) -> Option<usize> {
        self.floor.map(|(i, _)| i)
    }
}
