//! The k largest quadrature weights of each ray, less the smallest of them, with the sum 1.
//!
//! Weights are logarithms until only ratios matter.

use std::cmp::Ordering;

use field::{Real, Vector3};

use crate::density::{Motion, Weighting};
use crate::ray::WarpedRay;

/// A point that keeps a weight, or the *floor*: the point of the smallest of the k largest weights.
///
/// With w_0 the floor's weight and Σ = Σ_j (w_j − w_0), the share is p_i = w_i/Σ and the weight
/// ŵ_i = p_i − p_0. The floor is the entry of weight 0. The entries of a ray are in order along it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry<R> {
    pub(crate) ray: usize,
    pub(crate) index: usize,
    pub(crate) weight: R,
    share: R,
}

/// The entries of many rays, ray after ray; the other vectors are scratch memory.
#[derive(Debug)]
pub(crate) struct Quadrature<R> {
    pub(crate) entries: Vec<Entry<R>>,
    log: Vec<R>,
    order: Vec<usize>,
}

impl<R: Real> Quadrature<R> {
    /// The entries of all valid rays.
    pub(crate) fn of(
        weighting: &dyn Weighting<R>,
        k: usize,
        rays: &[WarpedRay<'_, R>],
        valid: &[bool],
    ) -> Self {
        let mut quadrature = Quadrature { entries: Vec::new(), log: Vec::new(), order: Vec::new() };
        for (number, ray) in rays.iter().enumerate().filter(|(number, _)| valid[*number]) {
            quadrature.add(weighting, k, ray, number);
        }
        quadrature
    }

    /// Adds the entries of a ray of finite numbers: its k largest weights, less the smallest of
    /// them.
    ///
    /// A ray with fewer than k points counts as filled up with points of weight zero: the floor is
    /// zero. So the weights are continuous where a ray gains a point, since the new point lies at
    /// the end of the interval and has Δ = 0.
    fn add(
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
            return self.add_tied(number);
        }
        for &index in &self.order {
            let ratio = ratio(index);
            if ratio > lowest || (Some(index) == floor && lowest > R::zero()) {
                let (weight, share) = ((ratio - lowest) / sum, ratio / sum);
                self.entries.push(Entry { ray: number, index, weight, share });
            }
        }
    }

    /// Adds the points in `order` with equal weights that do not move with u.
    ///
    /// This is for weights that tie exactly, where subtracting the floor leaves nothing. In
    /// practice such points are one point: a root that the recursion has converged on.
    fn add_tied(&mut self, number: usize) {
        let weight = R::one() / R::of(self.order.len() as f64);
        let tied = |&index| Entry { ray: number, index, weight, share: R::zero() };
        self.entries.extend(self.order.iter().map(tied));
    }

    /// Computes ln w = ln ρ + ln Δ, and orders the points with Δ > 0 from the largest weight to the
    /// smallest.
    fn rank(&mut self, weighting: &dyn Weighting<R>, ray: &WarpedRay<'_, R>) {
        // A NaN gets the weight 0: it could not be ordered.
        let log_weight = |i: usize| {
            let log = weighting.log_density(ray, i) + ray.step[i].ln();
            if log.is_nan() { R::neg_infinity() } else { log }
        };
        self.log.clear();
        self.log.extend((0..ray.t.len()).map(log_weight));
        self.order.clear();
        // A denormal Δ counts as 0: the derivative of its logarithm would overflow.
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
        // Δ = ρ |f|, and ρ cancels.
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
