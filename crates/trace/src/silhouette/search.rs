//! The search for one silhouette point: minima along rays, and Newton's method from ray to ray.

use field::{Real, Vector3};

use super::family::{RayFamily, Start, Tangency};
use super::minimum::{Minimum, RayPoint, on_different_faces};

// Evidence: one constant changed at a time, for 28 000 starts about the seven solids of
// tests/tracing.rs, with s an angle, a range of ±0.25 and a tolerance of 1e-6 radians, in double
// precision. With the values below 21 654 searches found a tangency, at 19.57 evaluations per
// start. At none of the values was |f| above 1e-4 at a found tangency.

/// Most evaluations along one ray. A kink takes about ten, a smooth minimum three.
const EVALUATIONS_PER_RAY: u32 = 40;

/// Most Newton steps of one search. Newton's method takes three or four where m is smooth.
const NEWTON_STEPS: u32 = 24;

/// Largest uncertainty of a minimum, as a fraction of its value, for a Newton step from it. At
/// 0.01: 21 709 found with 22.24 evaluations; at 0.2: 21 478 with 18.02.
const MINIMUM_TOLERANCE: f64 = 0.05;

/// Largest distance of two points on different faces that enclose a minimum at an edge, in units of
/// the tolerance on the surface. At 3: 19.68 evaluations, at 30: 19.51, and as many found.
const EDGE_WIDTH: f64 = 10.0;

/// If the interpolated gradient is shorter than this fraction of the points' gradients, they
/// cancel, and f may be negative nowhere. A solid without inner points (a solid minus itself) has a
/// surface and a kink everywhere. Such a tangency is checked on a ray inside. 0.01 and 0.3 change
/// nothing but 0.01 evaluations.
const CANCELLED_GRADIENT: f64 = 0.1;

/// Distance of the checking ray from the tangency, towards the inside, in tolerances. 2 and 16
/// change nothing.
const CHECK_DISTANCE: f64 = 4.0;

/// Smallest distance of a trial from the points on both sides, as a fraction of their distance.
const TRIAL_MARGIN: f64 = 0.01;

/// Along a ray, every third trial is where the tangents meet, which finds a kink.
const TANGENT_PERIOD: u32 = 3;

/// Along a ray, every eighth trial is the middle, which bounds the search.
const BISECTION_PERIOD: u32 = 8;

/// Allowance for the rounding of a point, in units in the last place of its distance.
const ROUNDING_ULPS: f64 = 4.0;

/// One search.
pub(super) struct Search<R: Real> {
    index: usize,
    start: Start<R>,
    /// The parameter of the current ray.
    s: R,
    /// The direction of the current ray.
    pub(super) direction: R::Vec3,
    /// The derivative of the direction by s.
    direction_dot: R::Vec3,
    /// The distance of the next evaluation.
    pub(super) t: R,
    /// The length of the step from there to the other side of the minimum.
    step: R,
    /// The points next to the minimum, before and after it.
    before: Option<RayPoint<R>>,
    after: Option<RayPoint<R>>,
    /// Evaluations along the current ray.
    evaluations: u32,
    newton_steps: u32,
    /// The last values of s with m > 0 and with m ≤ 0.
    outside: Option<R>,
    inside: Option<R>,
    /// Whether a step has been clamped to the range.
    clamped: bool,
    /// Whether points on different faces have to enclose the minimum tightly.
    tight: bool,
    /// A tangency with a cancelled gradient, while a ray inside is checked.
    unconfirmed: Option<Tangency<R>>,
}

/// The next action of a search.
pub(super) enum SearchStep<R: Real> {
    /// Evaluate f and ∇f at `Search::t` along `Search::direction`.
    Evaluate,
    /// The search has found its silhouette.
    Found(Tangency<R>),
    /// There is no silhouette in the range, or it was not found.
    Failed,
}

impl<R: Real> Search<R> {
    pub(super) fn new(
        family: &(impl RayFamily<R> + ?Sized),
        index: usize,
        start: Start<R>,
    ) -> Self {
        let (direction, direction_dot) = family.direction(index, start.s);
        Search {
            index,
            start,
            s: start.s,
            direction,
            direction_dot,
            t: start.t,
            step: start.reach,
            before: None,
            after: None,
            evaluations: 0,
            newton_steps: 0,
            outside: None,
            inside: None,
            clamped: false,
            tight: false,
            unconfirmed: None,
        }
    }

    /// Takes f and ∇f at the search's point and chooses the next action.
    pub(super) fn take_value(
        &mut self,
        family: &(impl RayFamily<R> + ?Sized),
        p: RayPoint<R>,
        tolerance: R,
    ) -> SearchStep<R> {
        self.evaluations += 1;
        let finite = p.f.is_finite() && p.gradient.is_finite();
        if !finite || self.evaluations > EVALUATIONS_PER_RAY || self.starts_too_steep(p) {
            return SearchStep::Failed;
        }
        *(if p.slope < R::zero() { &mut self.before } else { &mut self.after }) = Some(p);
        let (Some(a), Some(b)) = (self.before, self.after) else {
            return self.step_down(p);
        };
        let minimum = Minimum::between(a, b, self.direction_dot);
        let next = self.next_trial(&minimum);
        if self.is_known(&minimum, tolerance) || next <= a.t || next >= b.t {
            return self.newton_step(family, &minimum, tolerance);
        }
        self.t = next;
        SearchStep::Evaluate
    }

    /// Whether `p` is the first point of the search and the ray meets the surface too steeply.
    fn starts_too_steep(&self, p: RayPoint<R>) -> bool {
        self.evaluations == 1
            && self.newton_steps == 0
            && p.slope < -self.start.steepest * p.gradient.length()
    }

    /// Steps along the ray in the direction in which f falls; each step is twice the last one.
    fn step_down(&mut self, p: RayPoint<R>) -> SearchStep<R> {
        self.t = p.t + if p.slope < R::zero() { self.step } else { -self.step };
        self.step *= R::of(2.0);
        if self.t > R::zero() { SearchStep::Evaluate } else { SearchStep::Failed }
    }

    /// Whether the minimum is known well enough for a Newton step.
    fn is_known(&self, minimum: &Minimum<R>, tolerance: R) -> bool {
        let enough = (tolerance * minimum.slope.abs() * R::of(0.5))
            .max(R::of(MINIMUM_TOLERANCE) * minimum.f.abs());
        let rounding =
            R::epsilon() * R::of(ROUNDING_ULPS) * minimum.after.t.abs() * minimum.steepest();
        minimum.gap <= enough.max(rounding) && !(self.tight && self.is_loose(minimum, tolerance))
    }

    /// Whether the points are on different faces and far from the edge between them.
    fn is_loose(&self, minimum: &Minimum<R>, tolerance: R) -> bool {
        on_different_faces(minimum.before, minimum.after)
            && minimum.width()
                > tolerance * R::of(EDGE_WIDTH) * self.direction_dot.length() * minimum.after.t
    }

    /// The next trial along the ray: the expected zero of the slope, the meeting point of the
    /// tangents, or the middle.
    fn next_trial(&self, minimum: &Minimum<R>) -> R {
        let (a, b) = (minimum.before, minimum.after);
        let by_tangents = self.evaluations % TANGENT_PERIOD == TANGENT_PERIOD - 1;
        let next = if by_tangents { minimum.meeting } else { minimum.t };
        let margin = (b.t - a.t) * R::of(TRIAL_MARGIN);
        if self.evaluations % BISECTION_PERIOD == BISECTION_PERIOD - 1 {
            (a.t + b.t) * R::of(0.5)
        } else {
            next.max(a.t + margin).min(b.t - margin)
        }
    }

    /// Newton's step in s, to the next ray or to the result.
    fn newton_step(
        &mut self,
        family: &(impl RayFamily<R> + ?Sized),
        minimum: &Minimum<R>,
        tolerance: R,
    ) -> SearchStep<R> {
        self.newton_steps += 1;
        let m = minimum.f;
        self.note_sign(m);
        if let Some(tangency) = self.unconfirmed {
            return confirmed(tangency, minimum);
        }
        let next = self.s - m / minimum.slope;
        if !next.is_finite() || self.newton_steps > NEWTON_STEPS {
            return SearchStep::Failed;
        }
        if (next - self.s).abs() <= tolerance {
            return self.accept(family, minimum, next, tolerance);
        }
        let next = self.keep_in_range(next).and_then(|next| self.keep_in_bracket(next));
        let Some(next) = next else { return SearchStep::Failed };
        let to_surface = m.abs() / minimum.gradient.length().max(R::min_positive_value());
        self.restart_at(family, next, minimum.t, minimum.width().max(to_surface));
        SearchStep::Evaluate
    }

    /// Notes the sign of m at the current ray. It replaces that of an earlier estimate of the same
    /// ray: the first one may come from points far apart.
    fn note_sign(&mut self, m: R) {
        let (same, other) = if m > R::zero() {
            (&mut self.outside, &mut self.inside)
        } else {
            (&mut self.inside, &mut self.outside)
        };
        *same = Some(self.s);
        if *other == *same {
            *other = None;
        }
    }

    /// Accepts a converged tangency at `s`, unless its points have to move closer to an edge or an
    /// inside has to be confirmed first.
    fn accept(
        &mut self,
        family: &(impl RayFamily<R> + ?Sized),
        minimum: &Minimum<R>,
        s: R,
        tolerance: R,
    ) -> SearchStep<R> {
        if !self.tight && self.is_loose(minimum, tolerance) {
            self.tight = true;
            self.t = self.next_trial(minimum);
            return SearchStep::Evaluate;
        }
        let found = self.tangency(family, minimum, s);
        if minimum.gradient.length() >= R::of(CANCELLED_GRADIENT) * minimum.steepest() {
            return SearchStep::Found(found);
        }
        self.unconfirmed = Some(found);
        let inside = s - tolerance * R::of(CHECK_DISTANCE) * minimum.slope.signum();
        self.restart_at(family, inside, minimum.t, minimum.width());
        SearchStep::Evaluate
    }

    /// The tangency at `s`, from the minimum along the current ray.
    fn tangency(
        &self,
        family: &(impl RayFamily<R> + ?Sized),
        minimum: &Minimum<R>,
        s: R,
    ) -> Tangency<R> {
        let at = |t: R| family.origin(self.index) + self.direction * t;
        let (a, b) = (minimum.before, minimum.after);
        Tangency {
            s,
            t: minimum.t,
            points: [at(a.t), at(b.t)],
            weights: [R::one() - minimum.weight, minimum.weight],
            gradient: minimum.gradient,
            front: a.gradient,
            slope: minimum.slope,
            edge: on_different_faces(a, b),
            bend: (b.slope - a.slope) / (b.t - a.t).max(R::min_positive_value()),
        }
    }

    /// Clamps a step to the range. Fails at the second time, and for a step that leaves the range
    /// by more than its length: the silhouette is elsewhere.
    fn keep_in_range(&mut self, next: R) -> Option<R> {
        let [from, to] = self.start.range;
        if next < from || next > to {
            let length = to - from;
            if self.clamped || next < from - length || next > to + length {
                return None;
            }
            self.clamped = true;
            return Some(next.max(from).min(to));
        }
        Some(next)
    }

    /// Replaces a step that leaves the bracket of m's signs by a bisection. Fails if no
    /// floating-point number is left between its ends.
    fn keep_in_bracket(&self, next: R) -> Option<R> {
        let (Some(outside), Some(inside)) = (self.outside, self.inside) else {
            return Some(next);
        };
        let (low, high) = if outside < inside { (outside, inside) } else { (inside, outside) };
        let leaves = |s: R| s <= low || s >= high;
        let next = if leaves(next) { (low + high) * R::of(0.5) } else { next };
        (!leaves(next)).then_some(next)
    }

    /// Goes to the ray at `s`, to look for its minimum from `t`, with a first step of length `step`
    /// to its other side.
    fn restart_at(&mut self, family: &(impl RayFamily<R> + ?Sized), s: R, t: R, step: R) {
        (self.s, self.t, self.step) = (s, t, step);
        (self.direction, self.direction_dot) = family.direction(self.index, s);
        (self.before, self.after, self.evaluations) = (None, None, 0);
    }
}

/// A tangency with a cancelled gradient counts if f is negative on the ray beside it.
fn confirmed<R: Real>(tangency: Tangency<R>, minimum: &Minimum<R>) -> SearchStep<R> {
    let inside = minimum.before.f.min(minimum.after.f) < R::zero();
    if inside { SearchStep::Found(tangency) } else { SearchStep::Failed }
}
