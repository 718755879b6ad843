//! The warp field and its divergence for a batch of rays.

use field::{Field, Real, Vector3};

use crate::density::{Motion, Weighting};
use crate::projection::Projection;
use crate::ray::WarpedRay;
use crate::top_k::{Entry, Quadrature, normalise_rates};
use crate::warp::{SampleDivergence, Warp, WarpSample, WarpWithDivergence};

/// V of a batch of rays, from the k points of largest weight on each. `charts` has one chart per
/// ray, or one for all.
///
/// The records of the rays suffice: there is no evaluation of the field. A ray with a number that
/// is not finite, or that leads to one, has no samples; the other rays are not affected.
///
/// # Panics
/// If there are neither as many charts as rays nor one, or if the slices of a ray differ in length.
pub fn evaluate<R: Real, P: Projection<R> + ?Sized>(
    weighting: &dyn Weighting<R>,
    k: usize,
    charts: &[&P],
    rays: &[WarpedRay<'_, R>],
) -> Warp<R> {
    let charts = Charts::new(charts, rays);
    let mut warp = Warp { samples: Vec::new(), valid: valid(rays) };
    let quadrature = Quadrature::of(weighting, k, rays, &warp.valid);
    for group in quadrature.entries.chunk_by(|a, b| a.ray == b.ray) {
        let number = group[0].ray;
        let start = warp.samples.len();
        for entry in group.iter().filter(|entry| entry.weight > R::zero()) {
            let place = Place::new(entry, &rays[number], charts.of(number));
            warp.samples.push(place.sample(entry));
        }
        if !warp.samples[start..].iter().all(|s| s.a.iter().all(|a| a.is_finite())) {
            warp.samples.truncate(start);
            warp.valid[number] = false;
        }
    }
    warp
}

/// V of a batch of rays, as [`evaluate`], with the exact ∇_u·V of that V.
///
/// It evaluates two Hessian–vector products of the field at every sample, and at the floor of each
/// ray (the point whose weight is subtracted from the others), in two batches over all rays.
///
/// # Panics
/// As [`evaluate`].
pub fn evaluate_with_divergence<R: Real, P: Projection<R> + ?Sized>(
    field: &(impl Field<R> + ?Sized),
    weighting: &dyn Weighting<R>,
    k: usize,
    charts: &[&P],
    rays: &[WarpedRay<'_, R>],
) -> WarpWithDivergence<R> {
    let charts = Charts::new(charts, rays);
    let mut out = WarpWithDivergence {
        warp: Warp { samples: Vec::new(), valid: valid(rays) },
        derivatives: Vec::new(),
    };
    let entries = Quadrature::of(weighting, k, rays, &out.warp.valid).entries;
    let motions = motions(field, rays, &entries);
    let mut rates: Vec<[R; 2]> = entries
        .iter()
        .zip(&motions)
        .map(|(entry, motions)| {
            motions.map(|motion| entry.rate(weighting, &rays[entry.ray], &motion))
        })
        .collect();
    let mut next = 0;
    for group in entries.chunk_by(|a, b| a.ray == b.ray) {
        let (start, first, number) = (out.warp.samples.len(), next, group[0].ray);
        next += group.len();
        normalise_rates(group, &mut rates[first..next]);
        for (at, entry) in (first..).zip(group).filter(|(_, entry)| entry.weight > R::zero()) {
            let chart = charts.of(number);
            let place = Place::new(entry, &rays[number], chart);
            let sample = place.sample(entry);
            out.derivatives.push(place.divergence(&sample, chart, rates[at], &motions[at]));
            out.warp.samples.push(sample);
        }
        out.drop_if_not_finite(start, number);
    }
    out
}

/// For each ray, whether its record is finite.
fn valid<R: Real>(rays: &[WarpedRay<'_, R>]) -> Vec<bool> {
    rays.iter().map(|ray| ray.valid && ray.is_finite()).collect()
}

/// One chart per ray, or one for all.
struct Charts<'a, P: ?Sized>(&'a [&'a P]);

impl<'a, P: ?Sized> Charts<'a, P> {
    fn new<R: Real>(charts: &'a [&'a P], rays: &[WarpedRay<'_, R>]) -> Self {
        let count = charts.len();
        assert!(count == 1 || count == rays.len(), "{count} charts for {} rays", rays.len());
        Charts(charts)
    }

    fn of(&self, ray: usize) -> &'a P {
        self.0[if self.0.len() == 1 { 0 } else { ray }]
    }
}

/// A point with its first derivatives.
struct Place<R: Real> {
    x: R::Vec3,
    jacobian: [R::Vec3; 2],
    gradient: R::Vec3,
    /// |∇f|², kept away from zero.
    square: R,
}

impl<R: Real> Place<R> {
    fn new<P: Projection<R> + ?Sized>(entry: &Entry<R>, ray: &WarpedRay<'_, R>, chart: &P) -> Self {
        let (x, gradient) = (ray.x(entry.index), ray.gradient[entry.index]);
        let square = gradient.dot(gradient).max(R::min_positive_value());
        Place { x, jacobian: chart.jacobian(x), gradient, square }
    }

    /// m = ∇f/|∇f|²: the motion of the level set through the point as f falls by one.
    fn inverse(&self) -> R::Vec3 {
        self.gradient * (R::one() / self.square)
    }

    /// ∂m, given ∂∇f.
    fn inverse_derivative(&self, gradient: R::Vec3) -> R::Vec3 {
        let along = self.gradient.dot(gradient) / self.square;
        (gradient - self.gradient * (along + along)) * (R::one() / self.square)
    }

    /// The sample of an entry: a = ŵ J m.
    fn sample(&self, entry: &Entry<R>) -> WarpSample<R> {
        let Entry { ray, index, weight, .. } = *entry;
        let m = self.inverse();
        WarpSample {
            ray,
            index,
            x: self.x,
            weight,
            a: self.jacobian.map(|row| row.dot(m) * weight),
        }
    }

    /// ∇·a = Σ_e [∂_e ŵ J_e·m + ŵ (∂_e J_e·m + J_e·∂_e m)] and b = Σ_e a_e ∂_e x of a sample.
    fn divergence<P: Projection<R> + ?Sized>(
        &self,
        sample: &WarpSample<R>,
        chart: &P,
        weight_du: [R; 2],
        motion: &[Motion<R>; 2],
    ) -> SampleDivergence<R> {
        let m = self.inverse();
        let (mut divergence_a, mut b) = (R::zero(), R::Vec3::zero());
        for e in 0..2 {
            let moved = chart.jacobian_derivative(self.x, motion[e].x)[e].dot(m);
            let turned = self.jacobian[e].dot(self.inverse_derivative(motion[e].gradient));
            divergence_a +=
                weight_du[e] * self.jacobian[e].dot(m) + sample.weight * (moved + turned);
            b += motion[e].x * sample.a[e];
        }
        SampleDivergence { divergence_a, b }
    }
}

/// The motion of every entry's point with the film position, along both film axes.
///
/// t_{i+1} = t_i + ρ f(x_i) moves with all points before it, by their recorded gradients; only the
/// entries need second derivatives.
fn motions<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[WarpedRay<'_, R>],
    entries: &[Entry<R>],
) -> Vec<[Motion<R>; 2]> {
    let mut motions = Vec::with_capacity(entries.len());
    for group in entries.chunk_by(|a, b| a.ray == b.ray) {
        let (ray, mut next) = (&rays[group[0].ray], 0);
        let mut dt = ray.entry_du;
        for i in 0..=group[group.len() - 1].index {
            let dx: [R::Vec3; 2] =
                std::array::from_fn(|e| ray.direction_du[e] * ray.t[i] + ray.direction * dt[e]);
            if group[next].index == i {
                next += 1;
                motions.push(std::array::from_fn(|e| Motion {
                    direction: ray.direction_du[e],
                    t: dt[e],
                    exit: ray.exit_du[e],
                    x: dx[e],
                    gradient: R::Vec3::zero(),
                }));
            }
            for e in 0..2 {
                dt[e] += ray.relaxation * ray.gradient[i].dot(dx[e]);
            }
        }
    }
    let x: Vec<R::Vec3> = entries.iter().map(|e| rays[e.ray].x(e.index)).collect();
    set_gradient_motions(field, &x, &mut motions);
    motions
}

/// Sets ∂∇f = ∇²f ∂x of every motion, in one batch for both film axes: batches are often smaller
/// than a block of a network.
fn set_gradient_motions<R: Real>(
    field: &(impl Field<R> + ?Sized),
    x: &[R::Vec3],
    motions: &mut [[Motion<R>; 2]],
) {
    if x.is_empty() {
        return;
    }
    let x = x.repeat(2);
    let of_axis = |e: usize| motions.iter().map(move |motion| motion[e].x);
    let dx: Vec<R::Vec3> = of_axis(0).chain(of_axis(1)).collect();
    let (mut gradient, mut product) = (dx.clone(), dx.clone());
    field.hessian_vector(&x, &dx, &mut gradient, &mut product);
    for (e, products) in product.chunks(motions.len()).enumerate() {
        let pairs = motions.iter_mut().zip(products);
        pairs.for_each(|(motion, product)| motion[e].gradient = *product);
    }
}

impl<R: Real> WarpWithDivergence<R> {
    /// Removes the samples of ray `number`, from `start` on, if any of their numbers is not finite.
    fn drop_if_not_finite(&mut self, start: usize, number: usize) {
        let (samples, derivatives) = (&mut self.warp.samples, &mut self.derivatives);
        let finite = samples[start..].iter().all(|s| s.a.iter().all(|a| a.is_finite()))
            && derivatives[start..].iter().all(|d| d.divergence_a.is_finite() && d.b.is_finite());
        if !finite {
            samples.truncate(start);
            derivatives.truncate(start);
            self.warp.valid[number] = false;
        }
    }
}
