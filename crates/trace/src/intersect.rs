//! The first hit of every ray of a batch.

use field::{Field, Real};

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
    /// f there.
    pub f: R,
    /// The smallest f/t at a closest approach of f that the ray passed by: the tangent of the angle by which the ray clears
    /// the solid. For a hit, only approaches before it count; infinite if there was none.
    pub clearance: R,
    /// Evaluations of f.
    pub steps: u32,
}

/// A value of f along a ray.
#[derive(Clone, Copy, Debug)]
struct Point<R> {
    t: R,
    f: R,
}

/// What a ray waits for.
#[derive(Clone, Copy, Debug)]
enum Phase<R> {
    /// Walking; the last two points, newest first.
    March([Option<Point<R>>; 2]),
    /// Refining a closest approach between `from` and `to`, lowest so far `best`.
    Approach { from: Point<R>, best: Point<R>, to: Point<R>, left: u32 },
    /// Refining a root, with the refinements left.
    Root(Bracket<R>, u32),
}

/// A root between f > 0 at `outside` and f ≤ 0 at `inside`.
#[derive(Clone, Copy, Debug)]
struct Bracket<R> {
    outside: Point<R>,
    inside: Point<R>,
    /// The values that the secant uses for the two ends.
    weights: [R; 2],
    /// Which end was moved last.
    last: Option<usize>,
}

struct State<R> {
    ray: usize,
    t: R,
    phase: Phase<R>,
}

/// Refinements of one closest approach: parabolas converge in three or four; more would not change the sign.
const APPROACH_LIMIT: u32 = 6;

/// A closest approach is refined only if a parabola through its three points dips below this fraction of the lowest:
/// above it, no curvature that three points agree on brings f to zero.
const DIP: f64 = 0.4;

/// Refinements of one root; Illinois' method takes about six from a bracket of min_step in double precision.
const ROOT_LIMIT: u32 = 60;

/// Follow the slope of the last two values when f is below this fraction of the scale…
const NEAR: f64 = 0.05;

/// …but no further than this many times f: where the ray meets the surface at 15° or more that is the whole way.
const STRETCH: f64 = 4.0;

/// A little beyond where the slope says the root is, so that the root gets bracketed.
const BEYOND: f64 = 1.02;

/// Finds the first crossing from f > 0 to f ≤ 0 of every ray, one batch of values for all unfinished rays at a time.
///
/// `out` is cleared and gets one element a ray. Settings are taken as they are; see [`Options::validate`].
pub fn intersect<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[Ray<R>],
    options: &Options<R>,
    out: &mut Vec<Intersection<R>>,
) {
    let unknown =
        Intersection { outcome: Outcome::Miss, t: R::zero(), f: R::infinity(), clearance: R::infinity(), steps: 0 };
    out.clear();
    out.resize(rays.len(), unknown);
    let mut active: Vec<State<R>> =
        (0..rays.len()).map(|ray| State { ray, t: rays[ray].near, phase: Phase::March([None; 2]) }).collect();
    let (mut x, mut f) = (Vec::with_capacity(rays.len()), vec![R::zero(); rays.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|s| rays[s.ray].at(s.t)));
        let f = &mut f[..active.len()];
        field.value(&x, f);
        let mut values = f.iter();
        active.retain_mut(|state| {
            let value = values.next().copied().unwrap_or(R::nan());
            advance(state, value, &rays[state.ray], options, &mut out[state.ray])
        });
    }
}

/// Takes the value at the state's t; returns whether the ray goes on.
fn advance<R: Real>(s: &mut State<R>, f: R, ray: &Ray<R>, options: &Options<R>, out: &mut Intersection<R>) -> bool {
    let here = Point { t: s.t, f };
    out.steps += 1;
    if !f.is_finite() {
        (out.outcome, out.t, out.f) = (Outcome::Invalid, s.t, f);
        return false;
    }
    if out.steps >= options.step_limit && !matches!(s.phase, Phase::Root(..)) {
        return false;
    }
    match s.phase {
        Phase::March(before) => march(s, here, before, ray, options, out),
        Phase::Approach { from, best, to, left } => approach(s, here, [from, best, to], left, ray, options, out),
        Phase::Root(bracket, left) => aim(s, bracket.narrowed(here), left, ray, options, out),
    }
}

/// Remembers the lowest point, for rays that miss.
fn note<R: Real>(out: &mut Intersection<R>, p: Point<R>) {
    if p.f < out.f {
        (out.t, out.f) = (p.t, p.f);
    }
}

/// Remembers a closest approach.
fn pass<R: Real>(out: &mut Intersection<R>, p: Point<R>) {
    note(out, p);
    out.clearance = out.clearance.min(p.f / p.t.max(R::min_positive_value()));
}

fn march<R: Real>(
    s: &mut State<R>,
    here: Point<R>,
    before: [Option<Point<R>>; 2],
    ray: &Ray<R>,
    options: &Options<R>,
    out: &mut Intersection<R>,
) -> bool {
    if here.f <= R::zero() {
        let Some(outside) = before[0] else {
            (out.outcome, out.t, out.f) = (Outcome::Inside, here.t, here.f);
            return false;
        };
        return enter_root(s, outside, here, ray, options, out);
    }
    note(out, here);
    if let [Some(low), Some(from)] = before
        && low.f <= from.f
        && low.f < here.f
    {
        let dip = vertex(from, low, here).filter(|dip| dip.f < low.f);
        if let Some(dip) = dip.filter(|dip| dip.f < low.f * R::of(DIP)) {
            s.t = dip.t;
            s.phase = Phase::Approach { from, best: low, to: here, left: APPROACH_LIMIT };
            return true;
        }
        pass(out, dip.unwrap_or(low));
    }
    walk(s, here, before[0], ray, options, out)
}

/// Chooses the next step of a walking ray.
fn walk<R: Real>(
    s: &mut State<R>,
    here: Point<R>,
    last: Option<Point<R>>,
    ray: &Ray<R>,
    options: &Options<R>,
    out: &mut Intersection<R>,
) -> bool {
    if here.f * options.relaxation >= ray.far - here.t {
        // The rest of the interval is inside the ball that f says is empty. A miss still passes its closest approach.
        let closest = Point { t: out.t, f: out.f };
        pass(out, closest);
        return false;
    }
    let mut step = (here.f * options.relaxation).max(options.min_step * ray.scale);
    if let Some(last) = last
        && here.f < last.f
        && here.f < ray.scale * R::of(NEAR)
    {
        let to_root = here.f * (here.t - last.t) / (last.f - here.f) * R::of(BEYOND);
        step = step.max(to_root.min(here.f * R::of(STRETCH)));
    }
    s.t = (here.t + step).min(ray.far);
    s.phase = Phase::March([Some(here), last]);
    s.t > here.t
}

/// The vertex of the parabola through three points, if it opens upwards and lies between them.
fn vertex<R: Real>(a: Point<R>, b: Point<R>, c: Point<R>) -> Option<Point<R>> {
    let (left, right) = (b.t - a.t, c.t - b.t);
    let (down, up) = ((b.f - a.f) / left, (c.f - b.f) / right);
    let curvature = (up - down) / (left + right);
    let slope = (down * right + up * left) / (left + right);
    let shift = -slope / (curvature + curvature);
    let t = b.t + shift;
    let between = curvature > R::zero() && t > a.t && t < c.t;
    between.then(|| Point { t, f: b.f + shift * (slope + shift * curvature) })
}

fn approach<R: Real>(
    s: &mut State<R>,
    here: Point<R>,
    [from, best, to]: [Point<R>; 3],
    left: u32,
    ray: &Ray<R>,
    options: &Options<R>,
    out: &mut Intersection<R>,
) -> bool {
    if here.f <= R::zero() {
        // The root lies between the last point before the dip that is outside and this one.
        let outside = if best.t < here.t { best } else { from };
        return enter_root(s, outside, here, ray, options, out);
    }
    pass(out, here);
    // The lowest of the four stays in the middle of three.
    let (low, other) = if here.f < best.f { (here, best) } else { (best, here) };
    let (from, to) = if other.t < low.t { (other, to) } else { (from, other) };
    let dip = vertex(from, low, to).filter(|dip| left > 0 && dip.f < low.f * R::of(DIP) && dip.t != low.t);
    if let Some(dip) = dip {
        s.t = dip.t;
        s.phase = Phase::Approach { from, best: low, to, left: left - 1 };
        return true;
    }
    // Passed: go on from the far side, where f rises.
    s.phase = Phase::March([None; 2]);
    walk(s, to, None, ray, options, out)
}

fn enter_root<R: Real>(
    s: &mut State<R>,
    outside: Point<R>,
    inside: Point<R>,
    ray: &Ray<R>,
    options: &Options<R>,
    out: &mut Intersection<R>,
) -> bool {
    out.outcome = Outcome::Hit;
    let bracket = Bracket { outside, inside, weights: [outside.f, inside.f], last: None };
    aim(s, bracket, ROOT_LIMIT, ray, options, out)
}

/// Sends the next evaluation to where the secant of the weights crosses zero, or ends with the better end.
fn aim<R: Real>(
    s: &mut State<R>,
    bracket: Bracket<R>,
    left: u32,
    ray: &Ray<R>,
    options: &Options<R>,
    out: &mut Intersection<R>,
) -> bool {
    let Bracket { outside, inside, weights, .. } = bracket;
    let better = if outside.f < -inside.f { outside } else { inside };
    let t = outside.t + (inside.t - outside.t) * (weights[0] / (weights[0] - weights[1]));
    let stuck = !(t > outside.t && t < inside.t);
    if left == 0 || better.f.abs() <= options.tolerance * ray.scale || stuck {
        (out.t, out.f) = (better.t, better.f);
        return false;
    }
    s.t = t;
    s.phase = Phase::Root(bracket, left - 1);
    true
}

impl<R: Real> Bracket<R> {
    /// The bracket with `here` as one of its ends. Illinois: an end that stays for a second time counts half, so that it
    /// too will move.
    fn narrowed(mut self, here: Point<R>) -> Self {
        let side = usize::from(here.f <= R::zero());
        if self.last == Some(side) {
            self.weights[1 - side] *= R::of(0.5);
        } else {
            self.weights[1 - side] = if side == 0 { self.inside.f } else { self.outside.f };
        }
        self.weights[side] = here.f;
        *(if side == 0 { &mut self.outside } else { &mut self.inside }) = here;
        self.last = Some(side);
        self
    }
}
