//! The warp field and its divergence for a batch of rays, forward and in reverse.

use field::{Field, Real, Vector3};

use crate::Options;
use crate::weights::{Weights, spread, weights};

/// The chart between world and film: u = projection of x, in pixels.
pub trait Projection<R: Real> {
    /// The rows ∂u_x/∂x and ∂u_y/∂x, in pixels per world unit.
    fn jacobian(&self, x: R::Vec3) -> [R::Vec3; 2];
    /// The change of those rows as the point moves along `dx`.
    fn jacobian_derivative(&self, x: R::Vec3, dx: R::Vec3) -> [R::Vec3; 2];
}

/// A ray with the points that the tracer's recursion visited, and how it moves with the film position.
#[derive(Clone, Copy, Debug)]
pub struct WarpedRay<'a, R: Real> {
    /// o, the same for all film positions.
    pub origin: R::Vec3,
    /// d, of length 1.
    pub direction: R::Vec3,
    /// ∂d/∂u_x and ∂d/∂u_y, per pixel.
    pub direction_du: [R::Vec3; 2],
    /// ∂t_0/∂u: of where the recursion starts, world units per pixel.
    pub entry_du: [R; 2],
    /// ∂t/∂u of the interval's end, used where the last step was cut off there.
    pub exit_du: [R; 2],
    /// Distances of the points.
    pub t: &'a [R],
    /// f at the points.
    pub f: &'a [R],
    /// ∇f at the points.
    pub gradient: &'a [R::Vec3],
    /// Δ at the points.
    pub step: &'a [R],
    /// Whether the last Δ was cut off at the interval's end.
    pub clamped: bool,
    /// Whether the record is free of NaNs.
    pub valid: bool,
}

/// The points of a batch that keep a weight, with what V and its divergence need of them.
#[derive(Clone, Debug, Default)]
pub struct Kept<R: Real> {
    /// x_i.
    pub points: Vec<R::Vec3>,
    /// The ray of each point.
    pub ray: Vec<usize>,
    /// a_i = ŵ_i J m_i, in pixels per unit of f.
    pub a: Vec<[R; 2]>,
    /// ∇_u·a_i, per unit of f; empty if the divergence was not asked for.
    pub divergence_a: Vec<R>,
    /// b_i = Σ_e a_i,e ∂x_i/∂u_e, in world units per unit of f; empty if the divergence was not asked for.
    pub b: Vec<R::Vec3>,
    /// The number of rays in the batch.
    pub rays: usize,
    /// Rays that contribute nothing because something was not finite.
    pub invalid: usize,
}

/// A point whose second derivatives are asked for: of the ray, at the index, and its motion with the film.
struct Moving<R: Real> {
    ray: usize,
    index: usize,
    x: R::Vec3,
    dt: [R; 2],
    dx: [R::Vec3; 2],
}

/// Evaluates the warp of a batch of rays; `projection` has one chart a ray, or one for all.
///
/// With `divergence` the field is asked for two Hessian–vector products per kept point (and per smallest kept point);
/// without, for nothing.
pub fn evaluate<R: Real, P: Projection<R> + ?Sized>(
    field: &(impl Field<R> + ?Sized),
    options: &Options<R>,
    projection: &[&P],
    rays: &[WarpedRay<'_, R>],
    divergence: bool,
) -> Kept<R> {
    let mut kept = Kept { rays: rays.len(), ..Kept::default() };
    let all: Vec<Weights<R>> =
        rays.iter().map(|ray| if ray.valid { weights(options, ray) } else { Weights::default() }).collect();
    let chart = |ray: usize| projection[ray.min(projection.len() - 1)];
    let moving = if divergence { moving_points(options, rays, &all) } else { Vec::new() };
    let products = hessians(field, &moving);
    let mut next = 0;
    let mut rates = [Vec::new(), Vec::new()];
    for (r, (ray, weights)) in rays.iter().zip(&all).enumerate() {
        let start = kept.points.len();
        if divergence {
            let own = next..next + moving[next..].iter().take_while(|m| m.ray == r).count();
            next = own.end;
            let moving = &moving[own.clone()];
            for e in 0..2 {
                let log = |i: usize| {
                    moving.iter().position(|m| m.index == i).map_or(R::zero(), |at| {
                        log_weight_derivative(options, ray, &moving[at], products[e][own.start + at], e)
                    })
                };
                weights.derivative(log, &mut rates[e]);
            }
            for (p, &i) in weights.kept.iter().enumerate() {
                let Some(at) = moving.iter().position(|m| m.index == i) else { continue };
                let turn = [products[0][own.start + at], products[1][own.start + at]];
                kept.push_moving(ray, &moving[at], weights.weight[p], [rates[0][p], rates[1][p]], turn, chart(r));
            }
        } else {
            for (&i, weight) in weights.kept.iter().zip(&weights.weight) {
                let x = ray.origin + ray.direction * ray.t[i];
                let a = film_velocity::<R>(chart(r).jacobian(x), inverse::<R>(ray.gradient[i]), *weight);
                kept.push(r, x, a);
            }
        }
        kept.drop_if_not_finite(start, ray.valid);
    }
    kept
}

/// m = ∇f/|∇f|²: how a level set moves per unit that f falls.
fn inverse<R: Real>(gradient: R::Vec3) -> R::Vec3 {
    gradient * (R::one() / gradient.dot(gradient).max(R::min_positive_value()))
}

fn film_velocity<R: Real>(jacobian: [R::Vec3; 2], m: R::Vec3, weight: R) -> [R; 2] {
    jacobian.map(|row| row.dot(m) * weight)
}

/// The kept points and each ray's smallest, with their motion: t_{i+1} = t_i + ρ f(x_i) moves with all points before.
fn moving_points<R: Real>(options: &Options<R>, rays: &[WarpedRay<'_, R>], all: &[Weights<R>]) -> Vec<Moving<R>> {
    let mut out = Vec::new();
    for (r, (ray, weights)) in rays.iter().zip(all).enumerate() {
        let last = weights.kept.iter().copied().chain(weights.floor_index()).max();
        let mut dt = ray.entry_du;
        for index in 0..last.map_or(0, |last| last + 1) {
            let dx: [R::Vec3; 2] = std::array::from_fn(|e| ray.direction_du[e] * ray.t[index] + ray.direction * dt[e]);
            if weights.kept.contains(&index) || weights.floor_index() == Some(index) {
                let x = ray.origin + ray.direction * ray.t[index];
                out.push(Moving { ray: r, index, x, dt, dx });
            }
            for e in 0..2 {
                dt[e] += options.relaxation * ray.gradient[index].dot(dx[e]);
            }
        }
    }
    out
}

/// ∇²f ∂x for both film directions.
fn hessians<R: Real>(field: &(impl Field<R> + ?Sized), moving: &[Moving<R>]) -> [Vec<R::Vec3>; 2] {
    let n = moving.len();
    let x: Vec<R::Vec3> = moving.iter().map(|m| m.x).collect();
    let mut gradient = vec![R::Vec3::zero(); n];
    [0, 1].map(|e| {
        let dx: Vec<R::Vec3> = moving.iter().map(|m| m.dx[e]).collect();
        let mut product = vec![R::Vec3::zero(); n];
        if n > 0 {
            field.hessian_vector(&x, &dx, &mut gradient, &mut product);
        }
        product
    })
}

/// ∂ ln w = −γ ∂S/S + ∂Δ/Δ along film direction `e`; `turn` is ∇²f ∂x.
fn log_weight_derivative<R: Real>(
    options: &Options<R>,
    ray: &WarpedRay<'_, R>,
    m: &Moving<R>,
    turn: R::Vec3,
    e: usize,
) -> R {
    let (f, g, d) = (ray.f[m.index], ray.gradient[m.index], ray.direction);
    let sign = |v: R| if v < R::zero() { -R::one() } else { R::one() };
    let df = g.dot(m.dx[e]);
    let facing = turn.dot(d) + g.dot(ray.direction_du[e]);
    let ds = sign(f) * df + options.lambda_d * sign(g.dot(d)) * facing;
    let cut_off = ray.clamped && m.index + 1 == ray.t.len();
    let length = if cut_off { (ray.exit_du[e] - m.dt[e]) / ray.step[m.index] } else { df / f };
    length - options.gamma * ds / spread(options, ray, m.index)
}

impl<R: Real> Kept<R> {
    fn push(&mut self, ray: usize, x: R::Vec3, a: [R; 2]) {
        self.points.push(x);
        self.ray.push(ray);
        self.a.push(a);
    }

    /// Adds a point with its divergence: ∇·a = Σ_e [∂_e ŵ J_e·m + ŵ (∂_e J_e·m + J_e·∂_e m)].
    fn push_moving<P: Projection<R> + ?Sized>(
        &mut self,
        ray: &WarpedRay<'_, R>,
        at: &Moving<R>,
        weight: R,
        weight_du: [R; 2],
        turn: [R::Vec3; 2],
        chart: &P,
    ) {
        let g = ray.gradient[at.index];
        let (m, square) = (inverse::<R>(g), g.dot(g).max(R::min_positive_value()));
        let jacobian = chart.jacobian(at.x);
        let mut divergence = R::zero();
        for e in 0..2 {
            let along = g.dot(turn[e]) / square;
            let dm = (turn[e] - g * (along + along)) * (R::one() / square);
            let moved = chart.jacobian_derivative(at.x, at.dx[e])[e];
            divergence += weight_du[e] * jacobian[e].dot(m) + weight * (moved.dot(m) + jacobian[e].dot(dm));
        }
        let a = film_velocity::<R>(jacobian, m, weight);
        self.push(at.ray, at.x, a);
        self.divergence_a.push(divergence);
        self.b.push(at.dx[0] * a[0] + at.dx[1] * a[1]);
    }

    /// Takes back a ray's points, from `start` on, if any number is not finite.
    fn drop_if_not_finite(&mut self, start: usize, valid: bool) {
        let finite = self.a[start..].iter().all(|a| a[0].is_finite() && a[1].is_finite())
            && self.divergence_a.get(start..).is_none_or(|d| d.iter().all(|d| d.is_finite()))
            && self.b.get(start..).is_none_or(|b| b.iter().all(|b| b.is_finite()));
        if !finite {
            self.points.truncate(start);
            self.ray.truncate(start);
            self.a.truncate(start);
            self.divergence_a.truncate(start);
            self.b.truncate(start);
        }
        self.invalid += usize::from(!finite || !valid);
    }

    /// V of every ray, in pixels per unit of the parameter; `f_dot` is ∂_θ f at every kept point.
    pub fn velocity(&self, f_dot: &[R]) -> Vec<[R; 2]> {
        let mut v = vec![[R::zero(); 2]; self.rays];
        for (i, &ray) in self.ray.iter().enumerate() {
            for e in 0..2 {
                v[ray][e] -= self.a[i][e] * f_dot[i];
            }
        }
        v
    }

    /// ∇_u·V of every ray, per unit of the parameter; `f_dot` and `gradient_dot` are ∂_θ f and ∂_θ ∇f at every kept point.
    ///
    /// # Panics
    /// If the divergence was not asked for.
    pub fn divergence(&self, f_dot: &[R], gradient_dot: &[R::Vec3]) -> Vec<R> {
        let mut out = vec![R::zero(); self.rays];
        for (i, &ray) in self.ray.iter().enumerate() {
            out[ray] -= self.divergence_a[i] * f_dot[i] + self.b[i].dot(gradient_dot[i]);
        }
        out
    }

    /// VJP of θ ↦ V and ∇·V: the coefficients (α_i, c_i) at the kept points for `Field::parameter_vjp`, given a ray's adjoints
    /// of its divergence, `scalar` = δ·(L − c), and of its velocity, `film` = δ·∇_u L.
    ///
    /// # Panics
    /// If the divergence was not asked for.
    pub fn area_vjp(&self, scalar: &[R], film: &[[R; 2]]) -> (Vec<R>, Vec<R::Vec3>) {
        (0..self.points.len())
            .map(|i| {
                let (s, q) = (scalar[self.ray[i]], film[self.ray[i]]);
                let along = q[0] * self.a[i][0] + q[1] * self.a[i][1];
                (-(along + s * self.divergence_a[i]), -self.b[i] * s)
            })
            .unzip()
    }

    /// VJP of θ ↦ −flux: the coefficients α_i at the kept points for boundary samples with adjoints `flux` and edge normals
    /// along film axis `axis`. The boundary term enters a pixel as −(L − c) V·n, and V = −Σ a_i ∂_θ f: hence the plus.
    pub fn flux_vjp(&self, flux: &[R], axis: &[usize]) -> Vec<R> {
        self.ray.iter().zip(&self.a).map(|(&ray, a)| flux[ray] * a[axis[ray]]).collect()
    }
}
