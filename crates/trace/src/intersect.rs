//! The first hit of every ray of a batch: marching, and the choice of steps.

use field::{Field, Real};

use crate::root::{Approach, Bracket, Next, line_bound, vertex};
use crate::{Options, Ray};

/// How a ray ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It crosses the surface from outside.
    Hit,
    /// It does not, within its interval.
    Miss,
    /// It starts inside the solid.
    Inside,
    /// A NaN or an infinity was met.
    Invalid,
}

/// What was found along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection<R> {
    /// How the ray ended.
    pub outcome: Outcome,
    /// The distance of the hit; for a miss, of the closest approach.
    pub t: R,
    /// f there; for a miss that stayed clear of the surface, as a parabola through the nearest
    /// points has it.
    pub f: R,
    /// The smallest f/(L t) at a closest approach of f that the ray passed by, L the steepest slope
    /// met along it and at least 1: the tangent of the angle by which the ray clears the solid. For
    /// a hit, only approaches before it count; infinite if there was none.
    pub clearance: R,
    /// The distance of that closest approach; 0 if there was none.
    pub nearest: R,
    /// Evaluations of f.
    pub steps: u32,
}

/// A value of f along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point<R> {
    pub(crate) t: R,
    pub(crate) f: R,
}

/// What a ray waits for.
#[derive(Clone, Copy, Debug)]
enum Phase<R> {
    /// Walking.
    March,
    /// Looking for a negative value between two positive ones.
    Approach(Approach<R>),
    /// Refining a root.
    Root(Bracket<R>),
}

#[derive(Clone, Copy)]
struct State<R> {
    ray: usize,
    /// Where f is evaluated next.
    t: R,
    phase: Phase<R>,
    /// The last points on the way, newest first, all outside.
    last: [Option<Point<R>>; 2],
    /// The steepest |Δf/Δt| met so far, at least 1, and at least what a relaxation below 1 says of
    /// the field.
    slope: R,
}

/// The first step is no longer than this fraction of the scale: a field steeper than a distance
/// shows its slope before it can step over the whole solid. Without it, a ball whose f is five
/// times the distance is not seen at all.
const FIRST_STEP: f64 = 0.5;

/// Nor than this fraction of the interval, which may hug the solid.
const FIRST_PART: f64 = 0.25;

/// Steps of up to this many `min_step` may go beyond the ball that f says is empty.
const RESOLUTION: f64 = 2.0;

/// A step aims this far beyond where the root is expected, in parts of the way to it: the root gets
/// bracketed, tightly.
const BEYOND: f64 = 1.02;

/// How much further than f a step may go to an expected root that is not close: where the ray meets
/// the surface within 24° of its normal.
const HEAD_ON: f64 = 1.1;

/// The part of the step at which the balls of two points should just touch that is taken: less is
/// walked twice, more has to be taken back where f bends downwards.
const CAUTION: f64 = 0.95;

/// How many times f a step may go, with both ends' balls touching.
const MOST: f64 = 8.0;

/// Parts of L Δt by which the balls of two points may fail to touch, for rounding.
const SLACK: f64 = 1e-3;

/// Finds the first crossing from f > 0 to f ≤ 0 of every ray, one batch of values for all
/// unfinished rays at a time.
///
/// `out` is cleared and gets one element a ray. Settings are taken as they are; see
/// [`Options::validate`].
pub fn intersect<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[Ray<R>],
    options: &Options<R>,
    out: &mut Vec<Intersection<R>>,
) {
    let unknown = Intersection {
        outcome: Outcome::Miss,
        t: R::zero(),
        f: R::infinity(),
        clearance: R::infinity(),
        nearest: R::zero(),
        steps: 0,
    };
    out.clear();
    out.resize(rays.len(), unknown);
    let start = |ray: usize| State {
        ray,
        t: rays[ray].near,
        phase: Phase::March,
        last: [None; 2],
        slope: R::one() / options.relaxation,
    };
    let mut active: Vec<State<R>> = (0..rays.len()).map(start).collect();
    let (mut x, mut f) = (Vec::with_capacity(rays.len()), vec![R::zero(); rays.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|s| rays[s.ray].at(s.t)));
        let f = &mut f[..active.len()];
        field.value(&x, f);
        let mut values = f.iter();
        active.retain_mut(|state| {
            let f = values.next().copied().unwrap_or(R::nan());
            let (ray, out) = (&rays[state.ray], &mut out[state.ray]);
            let smallest = options.min_step * ray.scale;
            Tracer { ray, options, smallest, out }.advance(state, f)
        });
    }
}

/// One ray with where its result goes.
struct Tracer<'a, R: Real> {
    ray: &'a Ray<R>,
    options: &'a Options<R>,
    /// The shortest step, in world units.
    smallest: R,
    out: &'a mut Intersection<R>,
}

impl<R: Real> Tracer<'_, R> {
    /// Takes the value at the state's t; returns whether the ray goes on.
    fn advance(&mut self, s: &mut State<R>, f: R) -> bool {
        let here = Point { t: s.t, f };
        self.out.steps += 1;
        if !f.is_finite() {
            (self.out.outcome, self.out.t, self.out.f) = (Outcome::Invalid, s.t, f);
            return false;
        }
        match s.phase {
            Phase::Root(bracket) => self.root(s, bracket.narrowed(here)),
            _ if f > R::zero() && self.out.steps >= self.options.step_limit => {
                self.note(here);
                false
            }
            Phase::March => self.march(s, here),
            Phase::Approach(approach) => self.approach(s, approach, here),
        }
    }

    /// Remembers the lowest point, for rays that miss.
    fn note(&mut self, p: Point<R>) {
        if p.f < self.out.f {
            (self.out.t, self.out.f) = (p.t, p.f);
        }
    }

    /// Remembers a closest approach.
    fn pass(&mut self, p: Point<R>, slope: R) {
        self.note(p);
        let clearance = p.f / (slope * p.t).max(R::min_positive_value());
        if clearance < self.out.clearance {
            (self.out.clearance, self.out.nearest) = (clearance, p.t);
        }
    }

    fn march(&mut self, s: &mut State<R>, here: Point<R>) -> bool {
        let [Some(last), before] = s.last else {
            if here.f <= R::zero() {
                (self.out.outcome, self.out.t, self.out.f) = (Outcome::Inside, here.t, here.f);
                return false;
            }
            return self.walk(s, here);
        };
        let width = here.t - last.t;
        let secant = (here.f - last.f) / width;
        if width * R::of(2.0) > self.smallest {
            s.slope = s.slope.max(secant.abs());
        }
        // Nothing negative fits between two points whose balls touch.
        let touch = last.f + here.f.abs() >= s.slope * width * R::of(1.0 - SLACK);
        // Far from the origin a shorter step may be none: the limit ends that too.
        if !touch
            && width > self.smallest * R::of(RESOLUTION)
            && self.out.steps < self.options.step_limit
        {
            return self.step_back(s, last, here);
        }
        if here.f <= R::zero() {
            return self.enter_root(s, last, here);
        }
        if !touch {
            let slope_before = before.map_or(-s.slope, |b| (last.f - b.f) / (last.t - b.t));
            let approach = Approach::new(last, here, slope_before, s.slope);
            if line_bound(last, here, slope_before, s.slope).f <= R::zero()
                && let Some(t) = approach.first()
            {
                s.t = t;
                s.phase = Phase::Approach(approach);
                return true;
            }
        }
        self.note(here);
        if let Some(before) = before
            && last.f <= before.f
            && last.f < here.f
        {
            self.pass(
                vertex(before, last, here)
                    .filter(|v| v.f < last.f && v.f > R::zero())
                    .unwrap_or(last),
                s.slope,
            );
        }
        self.walk(s, here)
    }

    /// Discards a step that went too far for the slope that is known now.
    fn step_back(&mut self, s: &mut State<R>, last: Point<R>, here: Point<R>) -> bool {
        let t = last.t + (last.f / s.slope).max(self.smallest);
        s.t = t.min((last.t + here.t) * R::of(0.5));
        true
    }

    /// Makes `here` the newest point and chooses the next.
    fn walk(&mut self, s: &mut State<R>, here: Point<R>) -> bool {
        let [last, before] = s.last;
        s.last = [Some(here), last];
        s.phase = Phase::March;
        self.note(here);
        let clear = here.f / s.slope;
        let room = self.ray.far - self.ray.near;
        let first = (self.ray.scale * R::of(FIRST_STEP)).min(room * R::of(FIRST_PART));
        let mut step = last.map_or(clear.min(first), |last| {
            // If f goes on as it did, the ball there reaches back to the one here (Bálint and
            // Valasek 2018; Bán and Valasek 2023).
            let rate = (here.f - last.f) / (here.t - last.t);
            (clear * R::of(2.0 * CAUTION) * s.slope / (s.slope - rate).max(R::min_positive_value()))
                .max(clear)
                .min(clear * R::of(MOST))
        });
        if here.t >= self.ray.far || (last.is_some() && clear >= self.ray.far - here.t) {
            // The rest of the interval is inside the ball that f says is empty. A miss still passes
            // its closest approach.
            let closest = Point { t: self.out.t, f: self.out.f };
            self.pass(closest, s.slope);
            return false;
        }
        step = step.max(self.smallest);
        if let Some(to_root) = last.and_then(|last| expected_root(before, last, here)) {
            let aim = to_root * R::of(BEYOND);
            if aim <= (self.smallest * R::of(RESOLUTION)).max(clear * R::of(HEAD_ON)) {
                step = aim;
            }
        }
        // At least two representable distances, or the ray would stand still.
        step = step.max(here.t * R::epsilon() * R::of(2.0));
        s.t = (here.t + step).min(self.ray.far);
        true
    }

    fn approach(&mut self, s: &mut State<R>, mut approach: Approach<R>, here: Point<R>) -> bool {
        if here.f <= R::zero() {
            let outside = approach.before(here.t);
            return self.enter_root(s, outside, here);
        }
        self.note(here);
        match approach.narrow(here) {
            Next::Evaluate(t) => {
                s.t = t;
                s.phase = Phase::Approach(approach);
                true
            }
            Next::Clear => {
                let low = approach.lowest();
                if low.t < approach.end.t {
                    self.pass(low, s.slope);
                }
                s.last = [Some(low).filter(|low| low.t < approach.end.t), None];
                self.walk(s, approach.end)
            }
        }
    }

    fn enter_root(&mut self, s: &mut State<R>, outside: Point<R>, inside: Point<R>) -> bool {
        self.out.outcome = Outcome::Hit;
        self.root(s, Bracket::new(outside, inside))
    }

    /// Goes on with a root, or ends with the better side of its bracket.
    fn root(&mut self, s: &mut State<R>, mut bracket: Bracket<R>) -> bool {
        if let Some(t) = bracket.trial(self.options.tolerance * self.ray.scale) {
            s.t = t;
            s.phase = Phase::Root(bracket);
            return true;
        }
        let best = bracket.best();
        (self.out.t, self.out.f) = (best.t, best.f);
        false
    }
}

/// The distance from `here` to where f is expected to be zero, if f falls: by the parabola through
/// three points, by the secant of the last two if there are no more.
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
    // Written so that a NaN (no root) is none.
    (fall > R::zero() && root > R::zero()).then_some(root)
}
