//! The quadrature weights of rays' points, kept as logarithms until only ratios are left.

use std::cmp::Ordering;

use field::{Real, Vector3};

use crate::{Motion, WarpedRay, Weighting};

/// A point that takes part in the weights of its ray: one that keeps a weight, or the floor.
///
/// With w_0 the floor, the smallest of the k largest weights, and Σ = Σ_j (w_j − w_0), the share is
/// p_i = w_i/Σ and the weight ŵ_i = p_i − p_0. The floor itself is the entry of weight 0. The
/// entries of a ray are in order along it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry<R> {
    pub(crate) ray: usize,
    pub(crate) index: usize,
    pub(crate) weight: R,
    share: R,
}

/// The weights of many rays, one after the other; the vectors besides `entries` are scratch.
#[derive(Debug, Default)]
pub(crate) struct Quadrature<R> {
    pub(crate) entries: Vec<Entry<R>>,
    log: Vec<R>,
    order: Vec<usize>,
}

impl<R: Real> Quadrature<R> {
    /// Adds the entries of a ray of finite numbers: the k largest weights, less the smallest of
    /// those.
    ///
    /// A ray with fewer than k points is filled up with points of weight zero, so its weights are
    /// shifted by nothing. That makes them continuous where a ray gains a point: the new one lies
    /// at the end of the interval and has Δ = 0.
    ///
    /// If the kept weights all tie, the shift leaves nothing: the tied points then share the weight
    /// evenly, and keep it as u moves. They are one point in practice, a root that the recursion
    /// has converged on.
    pub(crate) fn add(
        &mut self,
        weighting: &dyn Weighting<R>,
        k: usize,
        ray: &WarpedRay<'_, R>,
        number: usize,
    ) {
        self.rank(weighting, ray);
        let Some(&first) = self.order.first() else { return };
        let floor = (self.order.len() >= k).then(|| self.order[k - 1]);
        self.order.truncate(k);
        self.order.sort_unstable();
        let ratio = |i: usize| (self.log[i] - self.log[first]).exp();
        let lowest = floor.map_or(R::zero(), ratio);
        let sum = self.order.iter().fold(R::zero(), |sum, &i| sum + (ratio(i) - lowest));
        if sum <= R::zero() {
            let weight = R::one() / R::of(self.order.len() as f64);
            let tied = self.order.iter().map(|&index| Entry {
                ray: number,
                index,
                weight,
                share: R::zero(),
            });
            return self.entries.extend(tied);
        }
        for &index in &self.order {
            let ratio = ratio(index);
            if ratio > lowest || (Some(index) == floor && lowest > R::zero()) {
                self.entries.push(Entry {
                    ray: number,
                    index,
                    weight: (ratio - lowest) / sum,
                    share: ratio / sum,
                });
            }
        }
    }

    /// Computes ln w = ln ρ + ln Δ and orders the points that stand for a length from the largest
    /// to the smallest.
    fn rank(&mut self, weighting: &dyn Weighting<R>, ray: &WarpedRay<'_, R>) {
        // A NaN weighs nothing: it could not be ordered.
        let log_weight = |i: usize| {
            let log = weighting.log_density(ray, i) + ray.step[i].ln();
            if log.is_nan() { R::neg_infinity() } else { log }
        };
        self.log.clear();
        self.log.extend((0..ray.t.len()).map(log_weight));
        self.order.clear();
        // A denormal length is none: the derivative of its logarithm would overflow.
        self.order.extend((0..ray.t.len()).filter(|&i| ray.step[i] >= R::min_positive_value()));
        // Ties by position, so that the order is the same on every machine.
        let log = &self.log;
        self.order.sort_unstable_by(|&a, &b| {
            log[b].partial_cmp(&log[a]).unwrap_or(Ordering::Equal).then(a.cmp(&b))
        });
    }
}

impl<R: Real> Entry<R> {
    /// ∂w/Σ = p ∂ ln w, where ∂ ln w = ∂ ln ρ + ∂Δ/Δ.
    pub(crate) fn rate(
        &self,
        weighting: &dyn Weighting<R>,
        ray: &WarpedRay<'_, R>,
        motion: &Motion<R>,
    ) -> R {
        if self.share == R::zero() {
            return R::zero();
        }
        let i = self.index;
        let f_rate = ray.gradient[i].dot(motion.x);
        // Δ is |f| times the relaxation, which drops out.
        let length = if ray.is_cut_off(i) {
            (motion.exit - motion.t) / ray.step[i]
        } else {
            f_rate / ray.f[i]
        };
        self.share * (length + weighting.log_density_rate(ray, i, motion))
    }
}

/// Turns the rates ∂w_i/Σ of the entries of one ray into ∂ŵ_i = r_i − r_0 − ŵ_i Σ_j (r_j − r_0),
/// both film axes at once.
pub(crate) fn normalise_rates<R: Real>(entries: &[Entry<R>], rates: &mut [[R; 2]]) {
    let floor =
        entries.iter().position(|e| e.weight == R::zero()).map_or([R::zero(); 2], |at| rates[at]);
    for e in 0..2 {
        let total = rates.iter().fold(R::zero(), |sum, rate| sum + (rate[e] - floor[e]));
        for (entry, rate) in entries.iter().zip(&mut *rates) {
            rate[e] = rate[e] - floor[e] - entry.weight * total;
        }
    }
}
