//! Silhouette points: where a turning ray just touches a surface.

use field::{Field, Real, Vector3};

/// A ray that turns about its origin: its direction at the angle parameter s, of length 1, and the
/// direction's derivative by s. Estimators let s be a film coordinate in pixels.
pub trait RayFamily<R: Real> {
    /// The origin that the rays of search `index` share.
    fn origin(&self, index: usize) -> R::Vec3;
    /// The direction of search `index` at `s`, and its derivative.
    fn direction(&self, index: usize, s: R) -> (R::Vec3, R::Vec3);
}

/// Where a search starts: near a closest approach of f to zero along the ray at s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start<R> {
    /// The ray's parameter.
    pub s: R,
    /// The distance along it.
    pub t: R,
    /// The values of s between which a silhouette is looked for.
    pub range: [R; 2],
    /// How far along the ray f is to be followed for a minimum, at first: about its width, in world
    /// units.
    pub reach: R,
    /// A ray that falls towards the surface at the start by more than this, as a cosine to its
    /// normal, has no silhouette near, and its search ends at once. 1 for all rays.
    pub steepest: R,
}

/// A ray that touches a surface: f = 0 and f has a minimum along it.
///
/// The minimum lies between two points, and the gradient there is their weighted mean: at an edge
/// of a solid, where f is kinked, the mean of both faces that is orthogonal to the ray; where f is
/// smooth, the interpolated gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangency<R: Real> {
    /// The parameter of the ray.
    pub s: R,
    /// The distance of the minimum.
    pub t: R,
    /// The points on both sides of it.
    pub points: [R::Vec3; 2],
    /// Their weights, 0 or more; they sum to 1.
    pub weights: [R; 2],
    /// ∇f at the minimum, orthogonal to the ray.
    pub gradient: R::Vec3,
    /// ∂m/∂s of m(s) = min_t f: positive where the solid is left as s grows.
    pub slope: R,
    /// Whether the points are on different faces: `gradient` is then no surface's normal.
    pub edge: bool,
    /// The second derivative of f along the ray at the minimum: large at an edge.
    pub bend: R,
}

/// A point of a ray with f and its slope along the ray.
#[derive(Clone, Copy, Debug)]
struct Point<R: Real> {
    t: R,
    f: R,
    slope: R,
    gradient: R::Vec3,
}

/// Evaluations along one ray before a search gives up: a kink takes about ten, a smooth minimum
/// three.
const INNER_LIMIT: u32 = 40;

/// Rays of one search. Newton's method takes three or four where m is smooth.
const OUTER_LIMIT: u32 = 24;

/// A minimum is known well enough for a Newton step when it is known to this part of its value.
const ROUGH: f64 = 0.05;

/// A point is at the bottom if its height above the tangents' meeting is this part of the other's.
/// Of a parabola it is then within a fifth of the interval.
const KINKED: f64 = 0.25;

/// Gradients that differ by this part are of two faces; one of these may lie behind a smooth
/// minimum that is not its own.
const FACES: f64 = 0.1;

/// How closely two faces enclose a minimum at an edge, in tolerances.
const TIGHT: f64 = 10.0;

/// Where the gradients on both sides of a minimum cancel to this part of them, there may be no
/// inside at all (a solid without its own points has a surface and a kink everywhere): it is looked
/// for.
const CANCELLED: f64 = 0.1;

/// How far inside, in tolerances.
const INSIDE: f64 = 4.0;

struct Search<R: Real> {
    index: usize,
    start: Start<R>,
    s: R,
    direction: R::Vec3,
    turn: R::Vec3,
    /// Where f is evaluated next, and the step to the other side of the minimum from there.
    t: R,
    step: R,
    /// The points before and after the minimum.
    before: Option<Point<R>>,
    after: Option<Point<R>>,
    inner: u32,
    outer: u32,
    /// The closest values of s with m > 0 and m < 0.
    outside: Option<R>,
    inside: Option<R>,
    clamped: bool,
    /// Whether points on different faces are to enclose the minimum closely.
    close: bool,
    /// What was found, while an inside is looked for.
    doubted: Option<Tangency<R>>,
}

/// What a search does next.
enum Step<R: Real> {
    Evaluate,
    Found(Tangency<R>),
    Failed,
}

/// Finds the silhouette near every start: s to `tolerance`, in the units of s. One element a start;
/// `None` where the search leaves its range, or finds no minimum.
///
/// By Newton's method on m(s) = min_t f, whose derivative is that of f at the minimum (the envelope
/// theorem), safeguarded by the signs of m. Costs values with gradients only, in batches over all
/// searches. Guarantees f = 0 at the minimum to `tolerance` times its slope; does not guarantee
/// that nothing hides the point.
pub fn tangencies<R: Real>(
    field: &(impl Field<R> + ?Sized),
    family: &(impl RayFamily<R> + ?Sized),
    starts: &[Start<R>],
    tolerance: R,
) -> Vec<Option<Tangency<R>>> {
    let mut out = vec![None; starts.len()];
    let mut active: Vec<Search<R>> = starts
        .iter()
        .enumerate()
        .map(|(index, start)| Search::new(family, index, *start))
        .collect();
    let (mut x, mut f, mut gradient) =
        (Vec::new(), vec![R::zero(); starts.len()], vec![R::Vec3::zero(); starts.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|s| family.origin(s.index) + s.direction * s.t));
        let (f, gradient) = (&mut f[..x.len()], &mut gradient[..x.len()]);
        field.value_gradient(&x, f, gradient);
        let mut values = f.iter().zip(gradient.iter());
        active.retain_mut(|search| {
            let Some((&f, &gradient)) = values.next() else { return false };
            let point = Point { t: search.t, f, slope: gradient.dot(search.direction), gradient };
            match search.advance(family, point, tolerance) {
                Step::Evaluate => true,
                Step::Found(tangency) => {
                    out[search.index] = Some(tangency);
                    false
                }
                Step::Failed => false,
            }
        });
    }
    out
}

impl<R: Real> Search<R> {
    fn new(family: &(impl RayFamily<R> + ?Sized), index: usize, start: Start<R>) -> Self {
        let (direction, rate) = family.direction(index, start.s);
        Search {
            index,
            start,
            s: start.s,
            direction,
            turn: rate,
            t: start.t,
            step: start.reach,
            before: None,
            after: None,
            inner: 0,
            outer: 0,
            outside: None,
            inside: None,
            clamped: false,
            close: false,
            doubted: None,
        }
    }

    fn advance(
        &mut self,
        family: &(impl RayFamily<R> + ?Sized),
        p: Point<R>,
        tolerance: R,
    ) -> Step<R> {
        self.inner += 1;
        if !p.f.is_finite() || !p.gradient.is_finite() || self.inner > INNER_LIMIT {
            return Step::Failed;
        }
        let start = self.inner == 1 && self.outer == 0;
        if start && p.slope < -self.start.steepest * p.gradient.length() {
            return Step::Failed;
        }
        *(if p.slope < R::zero() { &mut self.before } else { &mut self.after }) = Some(p);
        let (Some(a), Some(b)) = (self.before, self.after) else {
            // The minimum is further along the falling side.
            self.t = p.t + if p.slope < R::zero() { self.step } else { -self.step };
            self.step *= R::of(2.0);
            return if self.t > R::zero() { Step::Evaluate } else { Step::Failed };
        };
        let minimum = Minimum::of(a, b, self.turn);
        let known =
            (tolerance * minimum.rate.abs() * R::of(0.5)).max(R::of(ROUGH) * minimum.f.abs());
        // What rounding of the point makes of f.
        let rounding =
            R::epsilon() * R::of(4.0) * b.t.abs() * a.gradient.length().max(b.gradient.length());
        let next = self.between(a, b, &minimum);
        let known =
            minimum.gap <= known.max(rounding) && !(self.close && self.differ(a, b, tolerance));
        if known || next <= a.t || next >= b.t {
            return self.newton_step(family, a, b, &minimum, tolerance);
        }
        self.t = next;
        Step::Evaluate
    }

    /// Whether two points are on faces that differ, and not where these meet.
    fn differ(&self, a: Point<R>, b: Point<R>, tolerance: R) -> bool {
        on_different_faces(a, b) && b.t - a.t > tolerance * R::of(TIGHT) * self.turn.length() * b.t
    }

    /// The next place to look for the minimum: where the slope is expected to vanish, or where the
    /// tangents meet.
    fn between(&self, a: Point<R>, b: Point<R>, minimum: &Minimum<R>) -> R {
        let next = if self.inner % 3 == 2 { minimum.meeting } else { minimum.t };
        let margin = (b.t - a.t) * R::of(0.01);
        if self.inner % 8 == 7 {
            (a.t + b.t) * R::of(0.5)
        } else {
            next.max(a.t + margin).min(b.t - margin)
        }
    }

    /// Newton's step in s.
    fn newton_step(
        &mut self,
        family: &(impl RayFamily<R> + ?Sized),
        a: Point<R>,
        b: Point<R>,
        minimum: &Minimum<R>,
        tolerance: R,
    ) -> Step<R> {
        self.outer += 1;
        let (m, rate) = (minimum.f, minimum.rate);
        *(if m > R::zero() { &mut self.outside } else { &mut self.inside }) = Some(self.s);
        let mut next = self.s - m / rate;
        if let Some(tangency) = self.doubted {
            return if a.f.min(b.f) < R::zero() { Step::Found(tangency) } else { Step::Failed };
        }
        if !next.is_finite() || self.outer > OUTER_LIMIT {
            return Step::Failed;
        }
        if (next - self.s).abs() <= tolerance {
            if !self.close && self.differ(a, b, tolerance) {
                self.close = true;
                self.t = self.between(a, b, minimum);
                return Step::Evaluate;
            }
            let at = |t: R| family.origin(self.index) + self.direction * t;
            let found = Tangency {
                s: next,
                t: minimum.t,
                points: [at(a.t), at(b.t)],
                weights: [R::one() - minimum.share, minimum.share],
                gradient: minimum.gradient,
                slope: rate,
                edge: on_different_faces(a, b),
                bend: (b.slope - a.slope) / (b.t - a.t).max(R::min_positive_value()),
            };
            let steepest = a.gradient.length().max(b.gradient.length());
            if minimum.gradient.length() >= R::of(CANCELLED) * steepest {
                return Step::Found(found);
            }
            self.doubted = Some(found);
            self.restart_at(
                family,
                next - tolerance * R::of(INSIDE) * rate.signum(),
                minimum.t,
                b.t - a.t,
            );
            return Step::Evaluate;
        }
        let [from, to] = self.start.range;
        if next < from || next > to {
            // One try at the end of the range; what still leaves it, or leaves it by far, is not
            // here.
            let far = to - from;
            if self.clamped || next < from - far || next > to + far {
                return Step::Failed;
            }
            self.clamped = true;
            next = next.max(from).min(to);
        }
        if let (Some(outside), Some(inside)) = (self.outside, self.inside) {
            let (low, high) = if outside < inside { (outside, inside) } else { (inside, outside) };
            if next <= low || next >= high {
                next = (low + high) * R::of(0.5);
            }
            if next <= low || next >= high {
                return Step::Failed;
            }
        }
        let step =
            (b.t - a.t).max(m.abs() / minimum.gradient.length().max(R::min_positive_value()));
        self.restart_at(family, next, minimum.t, step);
        Step::Evaluate
    }

    /// Goes to the ray at s, to look for its minimum from t with a step to its other side.
    fn restart_at(&mut self, family: &(impl RayFamily<R> + ?Sized), s: R, t: R, step: R) {
        (self.s, self.t, self.step) = (s, t, step);
        (self.direction, self.turn) = family.direction(self.index, s);
        (self.before, self.after, self.inner) = (None, None, 0);
    }
}

/// Whether two points are on faces that differ.
fn on_different_faces<R: Real>(a: Point<R>, b: Point<R>) -> bool {
    let steepest = a.gradient.length().max(b.gradient.length());
    (b.gradient - a.gradient).length() > steepest * R::of(FACES)
}

/// What two points on both sides of a minimum say of it.
struct Minimum<R: Real> {
    t: R,
    f: R,
    /// How far f may lie below the lower of both points: where the tangents meet, a convex f is
    /// above.
    gap: R,
    meeting: R,
    /// The weight of the point behind.
    share: R,
    gradient: R::Vec3,
    /// ∂m/∂s.
    rate: R,
}

impl<R: Real> Minimum<R> {
    fn of(a: Point<R>, b: Point<R>, turn: R::Vec3) -> Self {
        let width = b.t - a.t;
        let share = -a.slope / (b.slope - a.slope).max(R::min_positive_value());
        let t = a.t + width * share;
        let meeting =
            a.t + (b.f - a.f - b.slope * width) / (a.slope - b.slope).min(-R::min_positive_value());
        let bound = a.f + a.slope * (meeting - a.t);
        let lower = a.f.min(b.f);
        // A parabola's minimum lies half-way down its tangent.
        let f = (a.f + a.slope * (t - a.t) * R::of(0.5)).max(bound).min(lower);
        let gradient = a.gradient * (R::one() - share) + b.gradient * share;
        // At a kink one point gets to the bottom, and where the slopes' secant vanishes says
        // nothing.
        let kinked = lower - bound < R::of(KINKED) * (a.f.max(b.f) - bound);
        let t = if !kinked {
            t
        } else if a.f < b.f {
            a.t
        } else {
            b.t
        };
        Minimum { t, f, gap: lower - bound, meeting, share, gradient, rate: gradient.dot(turn) * t }
    }
}
