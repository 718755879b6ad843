//! The warp field and its divergence for a batch of rays.

use field::{Field, Real, Vector3};

use crate::weights::{Entry, Quadrature, normalise_rates};
use crate::{Kept, Motion, Options, Projection, WarpedRay, Weighting};

/// Evaluates the warp of a batch of rays; `projection` has one chart a ray, or one for all.
///
/// With `divergence` the field is asked for two Hessian–vector products at every kept point and at
/// the point by whose weight a ray's weights are shifted, in two batches over all rays; without,
/// for nothing. A ray with a number that is not finite, or that leads to one, contributes nothing
/// (see [`Kept::valid`]); the others do not notice.
///
/// # Panics
/// If there are neither as many charts as rays nor one, or if the slices of a ray differ in length.
pub fn evaluate<R: Real, P: Projection<R> + ?Sized>(
    field: &(impl Field<R> + ?Sized),
    options: &Options<R>,
    projection: &[&P],
    rays: &[WarpedRay<'_, R>],
    divergence: bool,
) -> Kept<R> {
    evaluate_with(field, options, options, projection, rays, divergence)
}

/// The same with weights of one's own: of the options, k and the relaxation are used.
///
/// # Panics
/// As [`evaluate`].
pub fn evaluate_with<R: Real, P: Projection<R> + ?Sized>(
    field: &(impl Field<R> + ?Sized),
    options: &Options<R>,
    weighting: &dyn Weighting<R>,
    projection: &[&P],
    rays: &[WarpedRay<'_, R>],
    divergence: bool,
) -> Kept<R> {
    let charts = projection.len();
    assert!(charts == 1 || charts == rays.len(), "{charts} charts for {} rays", rays.len());
    let chart = |ray: usize| projection[if charts == 1 { 0 } else { ray }];
    let mut kept = Kept::of_rays(rays.iter().map(|ray| ray.valid && ray.is_finite()).collect());
    let mut quadrature = Quadrature::default();
    for (number, ray) in rays.iter().enumerate().filter(|(number, _)| kept.valid[*number]) {
        quadrature.add(weighting, options.k, ray, number);
    }
    let entries = &quadrature.entries;
    let motions = if divergence { motions(field, options, rays, entries) } else { Vec::new() };
    let mut rates: Vec<[R; 2]> = entries
        .iter()
        .zip(&motions)
        .map(|(entry, motions)| {
            motions.map(|motion| entry.rate(weighting, &rays[entry.ray], &motion))
        })
        .collect();
    let mut next = 0;
    for group in entries.chunk_by(|a, b| a.ray == b.ray) {
        let (start, first, number) = (kept.points.len(), next, group[0].ray);
        next += group.len();
        if divergence {
            normalise_rates(group, &mut rates[first..next]);
        }
        for (at, entry) in (first..).zip(group).filter(|(_, entry)| entry.weight > R::zero()) {
            let place = Place::new(entry, &rays[number], chart(number));
            kept.push(entry, &place);
            if divergence {
                kept.push_derivatives(entry, &place, chart(number), rates[at], &motions[at]);
            }
        }
        kept.drop_if_not_finite(start, number);
    }
    kept
}

/// What is known of a point without second derivatives.
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

    /// m = ∇f/|∇f|²: how a level set moves per unit that f falls.
    fn inverse(&self) -> R::Vec3 {
        self.gradient * (R::one() / self.square)
    }

    /// ∂m, given ∂∇f.
    fn inverse_derivative(&self, gradient: R::Vec3) -> R::Vec3 {
        let along = self.gradient.dot(gradient) / self.square;
        (gradient - self.gradient * (along + along)) * (R::one() / self.square)
    }
}

/// How every entry's point moves with the film. t_{i+1} = t_i + ρ f(x_i) moves with all points
/// before, by their recorded gradients; only the entries need second derivatives.
fn motions<R: Real>(
    field: &(impl Field<R> + ?Sized),
    options: &Options<R>,
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
                dt[e] += options.relaxation * ray.gradient[i].dot(dx[e]);
            }
        }
    }
    let x: Vec<R::Vec3> = entries.iter().map(|e| rays[e.ray].x(e.index)).collect();
    turn_gradients(field, &x, &mut motions);
    motions
}

/// ∂∇f = ∇²f ∂x, in one batch a film axis.
fn turn_gradients<R: Real>(
    field: &(impl Field<R> + ?Sized),
    x: &[R::Vec3],
    motions: &mut [[Motion<R>; 2]],
) {
    if x.is_empty() {
        return;
    }
    let mut dx = vec![R::Vec3::zero(); x.len()];
    let (mut gradient, mut product) = (dx.clone(), dx.clone());
    for e in 0..2 {
        dx.iter_mut().zip(&*motions).for_each(|(dx, motion)| *dx = motion[e].x);
        field.hessian_vector(x, &dx, &mut gradient, &mut product);
        motions
            .iter_mut()
            .zip(&product)
            .for_each(|(motion, product)| motion[e].gradient = *product);
    }
}

impl<R: Real> Kept<R> {
    /// Adds a point: a = ŵ J m.
    fn push(&mut self, entry: &Entry<R>, place: &Place<R>) {
        let m = place.inverse();
        self.points.push(place.x);
        self.ray.push(entry.ray);
        self.index.push(entry.index);
        self.weight.push(entry.weight);
        self.a.push(place.jacobian.map(|row| row.dot(m) * entry.weight));
    }

    /// Adds the divergence of the point just added, ∇·a = Σ_e [∂_e ŵ J_e·m + ŵ (∂_e J_e·m + J_e·∂_e
    /// m)], and its b.
    fn push_derivatives<P: Projection<R> + ?Sized>(
        &mut self,
        entry: &Entry<R>,
        place: &Place<R>,
        chart: &P,
        weight_du: [R; 2],
        motion: &[Motion<R>; 2],
    ) {
        let (m, a) = (place.inverse(), self.a[self.a.len() - 1]);
        let (mut divergence, mut b) = (R::zero(), R::Vec3::zero());
        for e in 0..2 {
            let moved = chart.jacobian_derivative(place.x, motion[e].x)[e].dot(m);
            let turned = place.jacobian[e].dot(place.inverse_derivative(motion[e].gradient));
            divergence += weight_du[e] * place.jacobian[e].dot(m) + entry.weight * (moved + turned);
            b += motion[e].x * a[e];
        }
        self.divergence_a.push(divergence);
        self.b.push(b);
    }

    /// Takes back the points of ray `number`, from `start` on, if any number is not finite.
    fn drop_if_not_finite(&mut self, start: usize, number: usize) {
        let finite = self.a[start..].iter().flatten().all(|a| a.is_finite())
            && self.divergence_a.get(start..).is_none_or(|d| d.iter().all(|d| d.is_finite()))
            && self.b.get(start..).is_none_or(|b| b.iter().all(|b| b.is_finite()));
        if !finite {
            self.points.truncate(start);
            self.ray.truncate(start);
            self.index.truncate(start);
            self.weight.truncate(start);
            self.a.truncate(start);
            self.divergence_a.truncate(start);
            self.b.truncate(start);
            self.valid[number] = false;
            self.invalid += 1;
        }
    }
}
