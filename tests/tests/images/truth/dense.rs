//! Networks: the first sign change of f in dense samples along a ray.

use field::Field;
use glam::DVec3;
use sdf_nn::Network;

use super::look::Look;
use super::rows::Seen;

/// Parts of the chord of the ball. A network takes 32 points at a time.
const SAMPLES: usize = 63;

/// Parts of an interval in each round of refinement. Its 16 points cost a network half as much as
/// 17.
const PARTS: usize = 15;

/// Rounds of refinement of a minimum: its interval shrinks to 2⁻¹¹ of the first, and the error of
/// f, which is of second order, to 2⁻²².
const ROUNDS: u32 = 4;

/// Rounds of refinement of a root: its interval shrinks to 2⁻¹¹ of the first. The error of a
/// straight line in it, which is of second order, is 2⁻²².
const ROOT_ROUNDS: u32 = 3;

/// The network's values along a ray.
struct Line<'a> {
    network: &'a Network<f64>,
    o: DVec3,
    d: DVec3,
}

impl Line<'_> {
    /// `parts` + 1 distances over an interval, and f there.
    fn samples(&self, [from, to]: [f64; 2], parts: usize) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> =
            (0..=parts).map(|i| from + (to - from) * i as f64 / parts as f64).collect();
        let x: Vec<DVec3> = t.iter().map(|t| self.o + self.d * *t).collect();
        let mut f = vec![0.0; x.len()];
        self.network.value(&x, &mut f);
        (t, f)
    }

    /// The first sample at or below 0 of an interval, or of the neighbourhood of the first local
    /// minimum that falls below 0 between samples. With the sample before it.
    fn below(&self, ends: [f64; 2], parts: usize, rounds: u32) -> Option<[f64; 2]> {
        let (t, f) = self.samples(ends, parts);
        for i in 1..=parts {
            if f[i] <= 0.0 {
                return Some([t[i - 1], t[i]]);
            }
            let lowest = i < parts && f[i] <= f[i - 1] && f[i] < f[i + 1];
            if lowest && rounds > 0 {
                let found = self.below([t[i - 1], t[i + 1]], PARTS, rounds - 1);
                if found.is_some() {
                    return found;
                }
            }
        }
        None
    }

    /// The root in an interval from f > 0 to f ≤ 0.
    fn root(&self, mut ends: [f64; 2]) -> f64 {
        let mut values = [1.0, -1.0];
        for _ in 0..ROOT_ROUNDS {
            let (t, f) = self.samples(ends, PARTS);
            let i = f[1..].iter().position(|f| *f <= 0.0).unwrap_or(PARTS - 1);
            (ends, values) = ([t[i], t[i + 1]], [f[i], f[i + 1]]);
        }
        let share = values[0] / (values[0] - values[1]);
        ends[0] + (ends[1] - ends[0]) * share.clamp(0.0, 1.0)
    }
}

/// The surface of {f ≤ 0} in the ball of a network that the ray from `o` along `d` hits first. The
/// eye is outside the ball.
pub(crate) fn see(look: &Look, network: &Network<f64>, o: DVec3, d: DVec3) -> Seen {
    let ball = Field::<f64>::bounds(network).unwrap();
    let r = o - ball.center;
    let (b, c) = (r.dot(d), r.dot(r) - ball.radius * ball.radius);
    if b * b <= c {
        return look.nothing();
    }
    let chord = [-b - (b * b - c).sqrt(), -b + (b * b - c).sqrt()];
    let line = Line { network, o, d };
    // Where the radiance is the same everywhere, distances and normals do not matter.
    let is_even = look.is_even();
    let at = |t: f64| o + d * t;
    let mut f = [0.0];
    network.value(&[at(chord[0])], &mut f);
    if f[0] <= 0.0 {
        let normal = (at(chord[0]) - ball.center).normalize();
        let (part, radiance) = look.lit(normal);
        let t = if is_even { 1.0 } else { chord[0] };
        return Seen { face: 2 + part, t, radiance };
    }
    let Some(ends) = line.below(chord, SAMPLES, ROUNDS) else {
        return look.nothing();
    };
    if is_even {
        let (part, radiance) = look.lit(d);
        return Seen { face: 4 + part, t: 1.0, radiance };
    }
    let t = line.root(ends);
    let mut gradient = [DVec3::ZERO];
    network.value_gradient(&[at(t)], &mut f, &mut gradient);
    let (part, radiance) = look.lit(gradient[0].normalize());
    Seen { face: 4 + part, t, radiance }
}
