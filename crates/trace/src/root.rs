//! A root of f along a ray, from a bracket.

use field::Real;

use crate::point::Point;

/// A root between f > 0 at `outside` and f ≤ 0 at `inside`.
///
/// Narrowed by the Illinois variant of regula falsi, which keeps both ends moving (Dowell and
/// Jarratt, "A modified regula falsi method for computing the root of an equation", BIT 11, 1971),
/// and by bisection where that is slow. The bracket always holds a sign change.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket<R> {
    outside: Point<R>,
    inside: Point<R>,
    /// The values that the secant uses for `outside` and `inside`.
    secant_values: [R; 2],
    /// The end that moved last: 0 for `outside`, 1 for `inside`.
    last_moved: Option<usize>,
    /// The width at the last check of progress.
    checked_width: R,
    /// Evaluations until the next check: by then the width has to be halved.
    until_check: u32,
    /// Evaluations left.
    left: u32,
}

/// Most evaluations of one root. The Illinois method takes three to six from a bracket of
/// `Options::min_step` in double precision. The width is halved at least once in seven evaluations
/// (a bisection, and twice [`HALVING_PERIOD`]), so 200 divide it by about 2²⁸ in the worst case.
const ROOT_EVALUATIONS: u32 = 200;

/// Evaluations in which the bracket has to become half as wide; if it does not, a bisection
/// follows. Views of seven solids in double precision took 7.39 evaluations per ray, 7.61 with a
/// period of 2, and 7.39 with 6.
const HALVING_PERIOD: u32 = 3;

impl<R: Real> Bracket<R> {
    /// A bracket whose points have been evaluated, with `outside` before `inside` on the ray.
    pub(crate) fn new(outside: Point<R>, inside: Point<R>) -> Self {
        Bracket {
            outside,
            inside,
            secant_values: [outside.f, inside.f],
            last_moved: None,
            checked_width: inside.t - outside.t,
            until_check: HALVING_PERIOD,
            left: ROOT_EVALUATIONS,
        }
    }

    /// The end with the smaller |f|.
    pub(crate) fn best(&self) -> Point<R> {
        if self.outside.f < -self.inside.f { self.outside } else { self.inside }
    }

    /// The distance of the next evaluation; `None` if |f| at an end is at most `tolerance`, if no
    /// floating-point number is left between the ends, or if no evaluation is left.
    pub(crate) fn trial(&mut self, tolerance: R) -> Option<R> {
        let (from, to) = (self.outside.t, self.inside.t);
        let middle = from + (to - from) * R::of(0.5);
        if self.left == 0 || self.best().f.abs() <= tolerance || middle <= from || middle >= to {
            return None;
        }
        self.left -= 1;
        if self.until_check == 0 {
            let slow = (to - from) * R::of(2.0) > self.checked_width;
            (self.checked_width, self.until_check) = (to - from, HALVING_PERIOD);
            if slow {
                return Some(middle);
            }
        }
        self.until_check -= 1;
        let [outside, inside] = self.secant_values;
        let t = from + (to - from) * (outside / (outside - inside));
        // The middle if rounding puts the secant's root on an end, or if it is a NaN.
        Some(if t > from && t < to { t } else { middle })
    }

    /// Makes `here` one of the ends. Illinois: an end that stays for the second time in a row
    /// counts with half of its value, so that it will move too.
    pub(crate) fn narrow(&mut self, here: Point<R>) {
        let moved = usize::from(here.f <= R::zero());
        if self.last_moved == Some(moved) {
            self.secant_values[1 - moved] *= R::of(0.5);
        } else {
            self.secant_values[1 - moved] = if moved == 0 { self.inside.f } else { self.outside.f };
        }
        self.secant_values[moved] = here.f;
        *(if moved == 0 { &mut self.outside } else { &mut self.inside }) = here;
        self.last_moved = Some(moved);
    }
}

#[cfg(test)]
mod tests;
