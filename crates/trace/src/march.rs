//! One ray: decisions on its values of f, and the choice of its steps.
//!
//! A positive value f with slopes of at most L says that the ball of radius f/L about the point is
//! empty. L is measured along the ray, so f need not be a distance.

use field::Real;

use crate::dip::{DipSearch, DipStep, line_bound, vertex};
use crate::intersection::{Intersection, Outcome};
use crate::lattice::{Lattice, Skip};
use crate::options::Options;
use crate::point::Point;
use crate::ray::Ray;
use crate::root::Bracket;

/// The purpose of a ray's next evaluation.
#[derive(Clone, Copy, Debug)]
enum Phase<R> {
    /// Going on along the ray.
    March,
    /// Looking for a negative value between two positive ones.
    Dip(DipSearch<R>),
    /// Refining a root.
    Root(Bracket<R>),
}

/// The state of an unfinished ray.
#[derive(Clone, Copy)]
pub(crate) struct RayState<R> {
    /// The distance of the next evaluation.
    pub(crate) t: R,
    phase: Phase<R>,
    /// The last two points of the march, newest first, all with f > 0.
    recent: [Option<Point<R>>; 2],
    /// The end of a step that was taken back.
    ahead: Option<Point<R>>,
    /// L: the steepest |Δf/Δt| met so far, at least 1/ρ with the relaxation ρ ≤ 1 of the options.
    steepest: R,
    /// The part of the ray before `t`, if it is skipped.
    skipped: Option<Skipped<R>>,
    /// Whether the lattice was right so far.
    trusts: bool,
}

/// A skipped part of a ray.
#[derive(Clone, Copy)]
struct Skipped<R> {
    /// The distance of its begin.
    from: R,
    /// A lower bound of f at its end.
    bound: R,
    /// ∂f/∂t there, by the lattice.
    slope: R,
}

impl<R: Real> RayState<R> {
    /// A ray that is evaluated first at distance `near`.
    pub(crate) fn new(near: R, options: &Options<R>) -> Self {
        RayState {
            t: near,
            phase: Phase::March,
            recent: [None; 2],
            ahead: None,
            steepest: R::one() / options.relaxation,
            skipped: None,
            trusts: true,
        }
    }
}

// Evidence: one constant changed at a time, in double precision. "Views": mean evaluations per ray
// of 128 × 128 rays at each of the seven solids of tests/tracing.rs, 7.39 with the values below.
// "Steep edge": 40 000 rays 1e-4 to 0.03 beside an edge of a box whose f is three times the
// distance, with relaxation 1: 10.5 evaluations per ray, none decided wrongly. Changes that name no
// wrong decision caused none there, nor for rays 1e-7 to 0.1 beside a ball's silhouette, nor for
// balls whose f is 2, 5 and 20 times the distance. Networks were not measured.

/// Longest first step, in units of `Ray::scale`. A field steeper than a distance then shows its
/// slope before a step can jump over the whole solid. Without this limit and the next one, a ball
/// whose f is five times the distance is not seen at all. Views at 0.25: 7.91; 1 changes nothing,
/// because the next limit is shorter there.
const FIRST_STEP_PER_SCALE: f64 = 0.5;

/// Longest first step as a fraction of the ray's interval, which may fit the solid closely: a first
/// step of half the scale could then jump over it. Views at 0.125: 7.95, at 0.5: 7.26.
const FIRST_STEP_PER_INTERVAL: f64 = 0.25;

/// Longest step, in units of the shortest step, that may leave the empty balls of its ends. Views
/// at 1: 7.56, at 4: 7.24 with 2 wrong decisions at the steep edge.
const UNCHECKED_STEP: f64 = 2.0;

/// Length of a step to an expected root, in units of the distance to that root. Above 1, so that
/// the step crosses the root and brackets it tightly. Views at 1.005: 7.38 with 14 wrong decisions
/// at the steep edge, at 1.1: 6.77 with 32.
const ROOT_OVERSHOOT: f64 = 1.02;

/// Longest step to an expected root, in units of the empty ball's radius, where the root is further
/// than [`UNCHECKED_STEP`]. With f a distance to a plane, such steps are taken where the ray meets
/// the plane within acos(1.02/1.1) = 22° of its normal. Views at 1: 6.76, at 1.5: 7.52.
const ROOT_STEP: f64 = 1.1;

/// Length of an over-relaxed step, in units of the step at which the empty balls of both ends just
/// touch if f goes on with its last slope. A smaller value takes shorter steps; a larger one has to
/// take back more steps where f bends downwards. Views at 0.85: 7.55, at 1: 7.38. All such steps
/// together save a fifth of the evaluations.
const TOUCHING_STEP: f64 = 0.95;

/// Longest over-relaxed step, in units of the empty ball's radius. Steep edge at 3: 11.0
/// evaluations, at 20: 10.4; views change by less than 0.02.
const LONGEST_STEP: f64 = 8.0;

/// Gap between the empty balls of two points that still counts as touching, as a fraction of
/// L Δt: an allowance for rounding. Views at 0: 7.46, at 1e-2: 7.05 with 2430 wrong decisions at
/// the steep edge.
const TOUCH_SLACK: f64 = 1e-3;

/// Length of a ray's interval, in units of `Ray::scale`, up to which the ray has the step limit of
/// the options. Longer rays have more steps in proportion: those above a floor, for example, which
/// end at its horizon. No ray of the gradient suite is as long.
const SCALES: f64 = 16.0;

/// The largest number of step limits that a long ray may take.
const MOST_LIMITS: f64 = 64.0;

/// One ray with the place of its result.
pub(crate) struct Tracer<'a, R: Real> {
    pub(crate) ray: &'a Ray<R>,
    pub(crate) options: &'a Options<R>,
    /// Values of f that show where the ray needs no evaluation.
    pub(crate) lattice: Option<&'a Lattice<R>>,
    /// The shortest step, in world units.
    pub(crate) min_step: R,
    pub(crate) found: &'a mut Intersection<R>,
}

impl<'a, R: Real> Tracer<'a, R> {
    /// A ray at the distance `t`.
    pub(crate) fn new(
        ray: &'a Ray<R>,
        options: &'a Options<R>,
        lattice: Option<&'a Lattice<R>>,
        t: R,
        found: &'a mut Intersection<R>,
    ) -> Self {
        let min_step = options.min_step * ray.scale.max(ray.spread * t);
        Tracer { ray, options, lattice, min_step, found }
    }

    /// Skips the part of the ray from the distance `from` on that the lattice shows to be empty, if
    /// it reaches further than the state's t. Returns whether the ray goes on.
    pub(crate) fn skip(&mut self, s: &mut RayState<R>, from: R) -> bool {
        let Some(lattice) = self.lattice.filter(|_| s.trusts) else { return true };
        // Of several closest approaches, only that with the smallest clearance counts.
        let reach = self.ray.reach.min(self.found.clearance);
        let skip = lattice.skip(self.ray, from, reach, s.steepest).filter(|skip| skip.t > s.t);
        let Some(skip) = skip else { return true };
        if skip.closest.f.is_finite() {
            self.note_approach(skip.closest, s.steepest);
        }
        let Skip { t, bound, slope, .. } = skip;
        (s.t, s.recent, s.skipped) = (t, [None; 2], Some(Skipped { from, bound, slope }));
        t < self.ray.far || self.end_beside(s)
    }

    /// Goes back to the begin `from` of a skipped part: the lattice was wrong there.
    fn go_back(&mut self, s: &mut RayState<R>, from: R) -> bool {
        (s.t, s.skipped, s.trusts) = (from, None, false);
        true
    }

    /// Takes the value of f at the state's t, and sets the next t. Returns whether the ray goes on.
    pub(crate) fn take_value(&mut self, s: &mut RayState<R>, f: R) -> bool {
        let here = Point { t: s.t, f };
        self.found.steps += 1;
        if !f.is_finite() {
            return self.end(Outcome::Invalid, here);
        }
        match &mut s.phase {
            Phase::Root(bracket) => {
                bracket.narrow(here);
                self.follow_root(&mut s.t, bracket)
            }
            _ if f > R::zero() && self.at_limit() => {
                self.note_lowest(here);
                false
            }
            Phase::March => self.march(s, here),
            Phase::Dip(search) => {
                let search = *search;
                self.search_dip(s, search, here)
            }
        }
    }

    /// Ends the ray at `here`.
    fn end(&mut self, outcome: Outcome, here: Point<R>) -> bool {
        (self.found.outcome, self.found.t, self.found.f) = (outcome, here.t, here.f);
        false
    }

    fn at_limit(&self) -> bool {
        let limit = self.options.step_limit;
        self.found.steps >= limit && {
            // A ray along a wide surface goes on for many scales.
            let scales = (self.ray.far - self.ray.near) / self.ray.scale;
            let times = (scales / R::of(SCALES)).max(R::one()).min(R::of(MOST_LIMITS));
            R::of(f64::from(self.found.steps)) >= R::of(f64::from(limit)) * times
        }
    }

    /// Keeps the lowest point, for rays that miss.
    fn note_lowest(&mut self, p: Point<R>) {
        if p.f < self.found.f {
            (self.found.t, self.found.f) = (p.t, p.f);
        }
    }

    /// Keeps the closest approach with the smallest clearance.
    fn note_approach(&mut self, p: Point<R>, steepest: R) {
        self.note_lowest(p);
        let clearance = p.f / (steepest * p.t).max(R::min_positive_value());
        if clearance < self.found.clearance {
            (self.found.clearance, self.found.nearest) = (clearance, p.t);
        }
    }

    /// Decides on a point of the march: go on, take the step back, or look for a root or a dip.
    fn march(&mut self, s: &mut RayState<R>, here: Point<R>) -> bool {
        let [Some(last), before] = s.recent else {
            if let Some(skipped) = s.skipped.filter(|skipped| here.f < skipped.bound) {
                return self.go_back(s, skipped.from);
            }
            if here.f <= R::zero() {
                return self.end(Outcome::Inside, here);
            }
            return self.advance_to_next(s, here);
        };
        let touch = self.balls_touch(s, last, here);
        // `min_step` may be below the spacing of floating-point numbers far from the origin: then
        // the step cannot be shortened, and the step limit ends the ray.
        let long = here.t - last.t > self.min_step * R::of(UNCHECKED_STEP);
        if !touch && long && !self.at_limit() {
            return self.step_back(s, last, here);
        }
        if here.f <= R::zero() {
            return self.enter_root(s, last, here);
        }
        if !touch && self.enter_dip(s, before, last, here) {
            return true;
        }
        self.note_lowest(here);
        self.note_minimum(s, before, last, here);
        if let Some(ahead) = s.ahead.take().filter(|ahead| self.balls_touch(s, here, *ahead)) {
            s.recent = [Some(here), Some(last)];
            return self.march(s, ahead);
        }
        self.advance_to_next(s, here)
    }

    /// Whether the empty balls of two points touch, so that f is not negative between them. Updates
    /// the steepest slope first.
    fn balls_touch(&self, s: &mut RayState<R>, last: Point<R>, here: Point<R>) -> bool {
        let width = here.t - last.t;
        let secant = (here.f - last.f) / width;
        // Over less than half of the shortest step, rounding of f may dominate the secant.
        if width * R::of(2.0) > self.min_step {
            s.steepest = s.steepest.max(secant.abs());
        }
        last.f + here.f.abs() >= s.steepest * width * R::of(1.0 - TOUCH_SLACK)
    }

    /// Takes back a step that was too long for the slope that it has shown.
    fn step_back(&mut self, s: &mut RayState<R>, last: Point<R>, here: Point<R>) -> bool {
        s.ahead = Some(here);
        let t = last.t + (last.f / s.steepest).max(self.min_step);
        s.t = t.min((last.t + here.t) * R::of(0.5));
        true
    }

    /// Starts a search between two positive values, if slopes allow a negative one there.
    fn enter_dip(
        &mut self,
        s: &mut RayState<R>,
        before: Option<Point<R>>,
        last: Point<R>,
        here: Point<R>,
    ) -> bool {
        let slope_before = before.map_or(-s.steepest, |b| (last.f - b.f) / (last.t - b.t));
        let search = DipSearch::new(last, here, slope_before, s.steepest);
        if line_bound(last, here, slope_before, s.steepest).f <= R::zero()
            && let Some(t) = search.first()
        {
            s.t = t;
            s.phase = Phase::Dip(search);
            return true;
        }
        false
    }

    /// Notes the closest approach if `last` is lower than both of its neighbours.
    fn note_minimum(
        &mut self,
        s: &RayState<R>,
        before: Option<Point<R>>,
        last: Point<R>,
        here: Point<R>,
    ) {
        if let Some(before) = before
            && last.f <= before.f
            && last.f < here.f
        {
            let below = vertex(before, last, here).filter(|v| v.f < last.f && v.f > R::zero());
            self.note_approach(below.unwrap_or(last), s.steepest);
        }
    }

    /// Makes `here` the newest point of the march and chooses the distance of the next one. Returns
    /// `false` where the rest of the interval is empty.
    fn advance_to_next(&mut self, s: &mut RayState<R>, here: Point<R>) -> bool {
        let [last, before] = s.recent;
        s.recent = [Some(here), last];
        s.phase = Phase::March;
        self.note_lowest(here);
        let rises = self.lattice.is_some() && last.is_some_and(|last| here.f > last.f);
        let radius = here.f / s.steepest;
        // After a skipped part, the slope of the lattice stands for the point before.
        let by_slope =
            |skipped: Skipped<R>| Point { t: here.t - radius, f: here.f - skipped.slope * radius };
        let last = match last {
            None => s.skipped.take().map(by_slope),
            last => last,
        };
        let step = match last {
            None => radius.min(self.first_step()),
            Some(last) => touching_step(s.steepest, radius, last, here),
        };
        if here.t >= self.ray.far || (last.is_some() && radius >= self.ray.far - here.t) {
            return self.end_beside(s);
        }
        let mut step = step.max(self.min_step);
        if let Some(to_root) = last.and_then(|last| expected_root(before, last, here)) {
            let aim = to_root * R::of(ROOT_OVERSHOOT);
            let longest = (self.min_step * R::of(UNCHECKED_STEP)).max(radius * R::of(ROOT_STEP));
            if aim <= longest {
                step = aim;
            }
        }
        // Two floating-point spacings: a shorter step could round to none.
        step = step.max(here.t * R::epsilon() * R::of(2.0));
        s.t = (here.t + step).min(self.ray.far);
        !rises || self.skip(s, here.t)
    }

    /// Ends a ray whose remaining interval is empty.
    fn end_beside(&mut self, s: &RayState<R>) -> bool {
        let closest = Point { t: self.found.t, f: self.found.f };
        if closest.f.is_finite() {
            self.note_approach(closest, s.steepest);
        }
        false
    }

    /// The longest first step, in world units.
    fn first_step(&self) -> R {
        let interval = self.ray.far - self.ray.near;
        (self.ray.scale * R::of(FIRST_STEP_PER_SCALE))
            .min(interval * R::of(FIRST_STEP_PER_INTERVAL))
    }

    /// Decides on a point of a dip search: refine a root, look again, or march on.
    fn search_dip(
        &mut self,
        s: &mut RayState<R>,
        mut search: DipSearch<R>,
        here: Point<R>,
    ) -> bool {
        if here.f <= R::zero() {
            let outside = search.before(here.t);
            return self.enter_root(s, outside, here);
        }
        self.note_lowest(here);
        match search.narrow(here) {
            DipStep::Evaluate(t) => {
                s.t = t;
                s.phase = Phase::Dip(search);
                true
            }
            DipStep::NoDip => {
                let low = search.lowest();
                if low.t < search.end.t {
                    self.note_approach(low, s.steepest);
                }
                s.recent = [Some(low).filter(|low| low.t < search.end.t), None];
                self.advance_to_next(s, search.end)
            }
        }
    }

    fn enter_root(&mut self, s: &mut RayState<R>, outside: Point<R>, inside: Point<R>) -> bool {
        self.found.outcome = Outcome::Hit;
        let mut bracket = Bracket::new(outside, inside);
        let unfinished = self.follow_root(&mut s.t, &mut bracket);
        s.phase = Phase::Root(bracket);
        unfinished
    }

    /// Sets `next`, the distance of the next evaluation of a root, or ends the ray at the better
    /// side of its bracket.
    fn follow_root(&mut self, next: &mut R, bracket: &mut Bracket<R>) -> bool {
        if let Some(t) = bracket.trial(self.options.tolerance * self.ray.scale) {
            *next = t;
            return true;
        }
        let best = bracket.best();
        (self.found.t, self.found.f) = (best.t, best.f);
        false
    }
}

/// The length of an over-relaxed step from `here`, with `radius` = f/L there: if f goes on with the
/// slope of the last two points, the empty ball at the end of the step reaches back to the one at
/// `here`.
///
/// Over-relaxation with a test whether the balls touch: Keinert, Schäfer, Korndörfer, Ganse and
/// Stamminger, "Enhanced Sphere Tracing", Smart Tools and Apps for Graphics 2014. The step from the
/// last slope: Bálint and Valasek, "Accelerating Sphere Tracing", Eurographics 2018 Short Papers;
/// Bán and Valasek, "Automatic Step Size Relaxation in Sphere Tracing", Eurographics 2023 Short
/// Papers.
fn touching_step<R: Real>(steepest: R, radius: R, last: Point<R>, here: Point<R>) -> R {
    let slope = (here.f - last.f) / (here.t - last.t);
    let gap = (steepest - slope).max(R::min_positive_value());
    (radius * R::of(2.0 * TOUCHING_STEP) * steepest / gap)
        .max(radius)
        .min(radius * R::of(LONGEST_STEP))
}

/// The distance from `here` to the next zero of f, if f falls: of the parabola through three
/// points, or of the line through the last two if there is no third.
fn expected_root<R: Real>(before: Option<Point<R>>, last: Point<R>, here: Point<R>) -> Option<R> {
    if here.f >= last.f {
        return None;
    }
    let width = here.t - last.t;
    let secant = (here.f - last.f) / width;
    let curvature = before.map_or(R::zero(), |b| {
        let earlier = (last.f - b.f) / (last.t - b.t);
        (secant - earlier) / (here.t - b.t)
    });
    let fall = -(secant + curvature * width);
    let discriminant = fall * fall - R::of(4.0) * curvature * here.f;
    let root = R::of(2.0) * here.f / (fall + discriminant.sqrt());
    // A NaN (no root) fails both comparisons.
    (fall > R::zero() && root > R::zero()).then_some(root)
}

#[cfg(test)]
mod tests;
