//! Between two points of a ray: is there a negative value, and where is the root?

use field::Real;

use crate::intersect::Point;

/// The vertex of the parabola through three points, if it opens upwards and lies between them.
pub(crate) fn vertex<R: Real>(a: Point<R>, b: Point<R>, c: Point<R>) -> Option<Point<R>> {
    let (left, right) = (b.t - a.t, c.t - b.t);
    let (down, up) = ((b.f - a.f) / left, (c.f - b.f) / right);
    let curvature = (up - down) / (left + right);
    let slope = (down * right + up * left) / (left + right);
    let shift = -slope / (curvature + curvature);
    let t = b.t + shift;
    let between = curvature > R::zero() && t > a.t && t < c.t;
    between.then(|| Point { t, f: b.f + shift * (slope + shift * curvature) })
}

/// Where two lines meet: one falling from `a` with `slope_a`, one rising to `b` with `slope_b`.
///
/// A convex f with these slopes outside [a, b] lies above both, so this is its lower bound. Where
/// the lines do not meet between a and b, f is not convex or has its minimum elsewhere, and the
/// lower end is returned.
pub(crate) fn line_bound<R: Real>(a: Point<R>, b: Point<R>, slope_a: R, slope_b: R) -> Point<R> {
    let width = b.t - a.t;
    let along = (b.f - a.f - slope_b * width) / (slope_a - slope_b);
    let meets = slope_a < R::zero() && slope_b > R::zero() && along > R::zero() && along < width;
    if meets {
        Point { t: a.t + along, f: a.f + slope_a * along }
    } else if a.f < b.f {
        a
    } else {
        b
    }
}

/// What to do about a possible dip.
pub(crate) enum Next<R> {
    /// Evaluate f here.
    Evaluate(R),
    /// There is no negative value, or none that can be told from rounding.
    Clear,
}

/// A search for a negative value between two positive ones.
///
/// A smooth dip is found by parabolas, a kinked one (an edge of a solid, seen from the side) by the
/// lines on both sides. The search stops when those lines meet above zero: then a convex f has no
/// negative value here.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach<R> {
    /// Where marching goes on.
    pub(crate) end: Point<R>,
    a: Point<R>,
    /// The lowest point between a and b, if one has been evaluated.
    low: Option<Point<R>>,
    b: Point<R>,
    /// The slope of f before a and after b.
    slopes: [R; 2],
    /// The value that the parabola gave for the point that is being evaluated.
    predicted: Option<R>,
    left: u32,
}

/// Evaluations of one search. Parabolas need two to four; rays within 1e-12 of a silhouette up to
/// ten.
const APPROACH_LIMIT: u32 = 16;

/// A minimum of a parabola that predicted its last point to this part of its value is taken for a
/// minimum of f.
const AGREEMENT: f64 = 0.1;

/// A vertex is tried if it is this part of the interval away from the lowest point.
const APART: f64 = 0.05;

/// A first trial keeps this part of the interval away from its ends.
const MARGIN: f64 = 0.1;

impl<R: Real> Approach<R> {
    /// A search between a and b, with the slopes of f before a and after b.
    pub(crate) fn new(a: Point<R>, b: Point<R>, slope_a: R, slope_b: R) -> Self {
        let slopes = [slope_a, slope_b];
        Approach { end: b, a, low: None, b, slopes, predicted: None, left: APPROACH_LIMIT }
    }

    /// The vertex of the parabola through both ends with the slope at a.
    fn trial(&self) -> R {
        let width = self.b.t - self.a.t;
        let bend = (self.b.f - self.a.f) / width - self.slopes[0];
        let along = -self.slopes[0] * width / (bend + bend);
        let margin = width * R::of(MARGIN);
        // A NaN or a parabola that opens downwards: the middle.
        let along = if bend > R::zero() {
            along.max(margin).min(width - margin)
        } else {
            width * R::of(0.5)
        };
        self.a.t + along
    }

    /// The last point before `t` that is known to be outside.
    pub(crate) fn before(&self, t: R) -> Point<R> {
        self.low.filter(|low| low.t < t).unwrap_or(self.a)
    }

    /// The lowest point so far.
    pub(crate) fn lowest(&self) -> Point<R> {
        let ends = if self.a.f < self.b.f { self.a } else { self.b };
        self.low.filter(|low| low.f <= ends.f).unwrap_or(ends)
    }

    /// Takes a positive value and says how to go on.
    pub(crate) fn narrow(&mut self, p: Point<R>) -> Next<R> {
        let agreed = self.predicted.is_some_and(|f| (f - p.f).abs() <= R::of(AGREEMENT) * p.f);
        self.insert(p);
        self.left -= 1;
        if agreed || self.left == 0 {
            return Next::Clear;
        }
        match self.next() {
            // What is not strictly between known points has been evaluated.
            Some((t, predicted)) if self.inner(t) => {
                self.predicted = predicted;
                Next::Evaluate(t)
            }
            _ => Next::Clear,
        }
    }

    /// The first place to look; none if rounding leaves nothing between the ends.
    pub(crate) fn first(&self) -> Option<R> {
        Some(self.trial()).filter(|t| self.inner(*t))
    }

    fn inner(&self, t: R) -> bool {
        t > self.a.t && t < self.b.t && self.low.is_none_or(|low| t != low.t)
    }

    /// Keeps the lowest point in the middle.
    fn insert(&mut self, p: Point<R>) {
        let low = match self.low {
            None => p,
            Some(low) if p.f < low.f => {
                if p.t < low.t {
                    self.cut_after(p, low)
                } else {
                    self.cut_before(low, p)
                }
                p
            }
            Some(low) => {
                if p.t < low.t {
                    self.cut_before(p, low)
                } else {
                    self.cut_after(low, p)
                }
                low
            }
        };
        self.low = Some(low);
        if low.f >= self.a.f {
            // The minimum of a convex f is at a or before it.
            self.cut_after(self.a, low);
            self.low = None;
        } else if low.f >= self.b.f {
            self.cut_before(low, self.b);
            self.low = None;
        }
    }

    /// Makes `p` the right end; f has the slope from p to the old end after it. `inside` is the
    /// neighbour on p's left.
    fn cut_after(&mut self, inside: Point<R>, p: Point<R>) {
        debug_assert!(inside.t < p.t);
        self.slopes[1] = (self.b.f - p.f) / (self.b.t - p.t);
        self.b = p;
    }

    /// Makes `p` the left end. `inside` is the neighbour on p's right.
    fn cut_before(&mut self, p: Point<R>, inside: Point<R>) {
        debug_assert!(inside.t > p.t);
        self.slopes[0] = (p.f - self.a.f) / (p.t - self.a.t);
        self.a = p;
    }

    /// Where to look next, with what a parabola says f is there; none if no convex f can be
    /// negative.
    fn next(&self) -> Option<(R, Option<R>)> {
        let Some(low) = self.low else {
            let bound = line_bound(self.a, self.b, self.slopes[0], self.slopes[1]);
            return (bound.f <= R::zero()).then(|| (self.trial(), None));
        };
        let [before, after] = [
            line_bound(self.a, low, self.slopes[0], (self.b.f - low.f) / (self.b.t - low.t)),
            line_bound(low, self.b, (low.f - self.a.f) / (low.t - self.a.t), self.slopes[1]),
        ];
        let bound = if before.f < after.f { before } else { after };
        if bound.f > R::zero() {
            return None;
        }
        // Parabolas and lines take turns: whichever fits f converges. A vertex next to the lowest
        // point would agree with it in value whatever f does, and tell nothing.
        let apart = R::of(APART) * (self.b.t - self.a.t);
        let parabola = vertex(self.a, low, self.b)
            .filter(|v| !self.left.is_multiple_of(3) && (v.t - low.t).abs() > apart);
        Some(parabola.map_or((bound.t, None), |v| (v.t, Some(v.f).filter(|_| self.rounded(low)))))
    }

    /// Whether the parabola through both ends and `low` bends no further than a convex f can with
    /// its slopes outside them. Through the points of a kink it does, and may agree with one more
    /// of them by chance.
    fn rounded(&self, low: Point<R>) -> bool {
        let (left, right) = (low.t - self.a.t, self.b.t - low.t);
        let (down, up) = ((low.f - self.a.f) / left, (self.b.f - low.f) / right);
        let curvature = (up - down) / (left + right);
        let slack = R::of(AGREEMENT) * curvature * (left + right);
        down - curvature * left >= self.slopes[0] - slack
            && up + curvature * right <= self.slopes[1] + slack
    }
}

/// A root between f > 0 at `outside` and f ≤ 0 at `inside`, narrowed by the secants of Illinois'
/// method, which keep both ends moving, and by bisection where those are slow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket<R> {
    outside: Point<R>,
    inside: Point<R>,
    /// The values that the secant uses for the two ends.
    weights: [R; 2],
    /// Which end was moved last.
    last: Option<usize>,
    /// The width that has to be halved before `due` evaluations.
    width: R,
    due: u32,
    left: u32,
}

/// Evaluations of one root. Illinois' method takes three to six from a bracket of `min_step` in
/// double precision; with a bisection for every three, 200 close any bracket.
const ROOT_LIMIT: u32 = 200;

/// Evaluations in which a bracket has to become half as wide.
const PATIENCE: u32 = 3;

impl<R: Real> Bracket<R> {
    pub(crate) fn new(outside: Point<R>, inside: Point<R>) -> Self {
        let weights = [outside.f, inside.f];
        let width = inside.t - outside.t;
        Bracket { outside, inside, weights, last: None, width, due: PATIENCE, left: ROOT_LIMIT }
    }

    /// The end with the smaller |f|.
    pub(crate) fn best(&self) -> Point<R> {
        if self.outside.f < -self.inside.f { self.outside } else { self.inside }
    }

    /// Where to look next; none if f is zero to the tolerance, or nothing representable is left
    /// between the ends.
    pub(crate) fn trial(&mut self, tolerance: R) -> Option<R> {
        let (from, to) = (self.outside.t, self.inside.t);
        let middle = from + (to - from) * R::of(0.5);
        if self.left == 0 || self.best().f.abs() <= tolerance || middle <= from || middle >= to {
            return None;
        }
        self.left -= 1;
        if self.due == 0 {
            let slow = (to - from) * R::of(2.0) > self.width;
            (self.width, self.due) = (to - from, PATIENCE);
            if slow {
                return Some(middle);
            }
        }
        self.due -= 1;
        let t = from + (to - from) * (self.weights[0] / (self.weights[0] - self.weights[1]));
        // At an end to rounding (or a NaN, if the weights vanish): the middle moves at least.
        Some(if t > from && t < to { t } else { middle })
    }

    /// The bracket with `here` as one of its ends. Illinois: an end that stays for a second time
    /// counts half, so that it too will move.
    pub(crate) fn narrowed(mut self, here: Point<R>) -> Self {
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
