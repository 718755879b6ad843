//! The warp of a ball in front of a pinhole camera, written from the formulas of `docs/math` alone:
//! an implementation of its own, which shares no code with the crates of the renderer.

/// A vector of world space.
pub(super) type Vector = [f64; 3];

/// A film position or a film vector, in pixels.
pub(super) type Film = [f64; 2];

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

pub(super) fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// a + s b.
pub(super) fn plus(a: Vector, s: f64, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + s * b[i])
}

fn times(s: f64, a: Vector) -> Vector {
    a.map(|v| s * v)
}

/// The camera looks along −z, with its film's x axis along x and the film's y axis along −y.
const FORWARD: Vector = [0.0, 0.0, -1.0];
const AXES: [Vector; 2] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];

/// A ball at the origin, seen from (0, 0, `distance`). The scene `disc.constant` of the suite.
#[derive(Clone, Copy)]
pub(super) struct Ball {
    /// The radius r, in world units.
    pub(super) radius: f64,
    /// The distance D of the eye, in world units.
    pub(super) distance: f64,
    /// The focal length F, in pixels.
    pub(super) focal: f64,
    /// Both coordinates of the principal point, in pixels.
    pub(super) principal: f64,
    /// The radius R of the bounding sphere, in world units.
    pub(super) bounds: f64,
}

pub(super) const BALL: Ball =
    Ball { radius: 0.7, distance: 4.0, focal: 24.0, principal: 8.0, bounds: 1.05 };

/// A number of the scene that the image is differentiated by.
#[derive(Clone, Copy)]
pub(super) enum Parameter {
    Radius,
    /// A coordinate of the centre.
    Center(usize),
}

/// The settings of the published warp, lengths in bounding radii.
#[derive(Clone, Copy)]
pub(super) struct Settings {
    pub(super) points: usize,
    pub(super) top_k: usize,
    pub(super) gamma: f64,
    pub(super) lambda_d: f64,
    pub(super) epsilon: f64,
}

/// The defaults of derivative images.
pub(super) const SETTINGS: Settings =
    Settings { points: 22, top_k: 14, gamma: 3.0, lambda_d: 1.0, epsilon: 1e-6 };

/// A point of the sphere tracer, with its weights.
#[derive(Clone, Copy)]
pub(super) struct Visit {
    pub(super) t: f64,
    pub(super) x: Vector,
    /// w: the weight before the floor is subtracted.
    pub(super) raw: f64,
    /// ŵ; the weights of a ray sum to 1.
    pub(super) weight: f64,
}

impl Ball {
    pub(super) fn eye(&self) -> Vector {
        [0.0, 0.0, self.distance]
    }

    /// The unit direction through a film position.
    pub(super) fn direction(&self, u: Film) -> Vector {
        let p = u.map(|v| (v - self.principal) / self.focal);
        let through = plus(plus(FORWARD, p[0], AXES[0]), p[1], AXES[1]);
        times(length(through).recip(), through)
    }

    /// f at the distance `t` along the ray through u.
    pub(super) fn value(&self, u: Film, t: f64) -> f64 {
        length(plus(self.eye(), t, self.direction(u))) - self.radius
    }

    /// m(u) = min_t f, and the distance of this minimum.
    pub(super) fn closest(&self, u: Film) -> (f64, f64) {
        let t = -dot(self.eye(), self.direction(u));
        (self.value(u, t), t)
    }

    /// The radius of the outline on the film: F r/√(D² − r²).
    pub(super) fn outline(&self) -> f64 {
        self.focal * self.radius / (self.distance.powi(2) - self.radius.powi(2)).sqrt()
    }

    /// The normal velocity of the outline, in pixels per unit of the parameter, where its outward
    /// normal on the film is n.
    pub(super) fn velocity(&self, parameter: Parameter, n: Film) -> f64 {
        let Ball { radius, distance, focal, .. } = *self;
        let cube = (distance.powi(2) - radius.powi(2)).powf(1.5);
        match parameter {
            Parameter::Radius => focal * distance.powi(2) / cube,
            Parameter::Center(2) => focal * radius * distance / cube,
            // The closest approach lies in the direction of n, turned towards the eye.
            Parameter::Center(axis) => {
                let radial = focal * distance / (distance.powi(2) - radius.powi(2));
                radial * n[axis] * AXES[axis][axis]
            }
        }
    }

    /// The distances at which the ray through u enters and leaves the bounding sphere.
    fn ends(&self, u: Film) -> Option<[f64; 2]> {
        let (away, t) = self.closest(u);
        let half = (self.bounds.powi(2) - (away + self.radius).powi(2)).sqrt();
        (!half.is_nan()).then_some([t - half, t + half])
    }

    /// The points that sphere tracing visits along the ray through u, with their weights.
    pub(super) fn visits(&self, u: Film, settings: &Settings) -> Vec<Visit> {
        let Some([near, far]) = self.ends(u) else { return Vec::new() };
        let d = self.direction(u);
        let mut visits = Vec::new();
        let mut t = near;
        for _ in 0..settings.points {
            let x = plus(self.eye(), t, d);
            let f = length(x) - self.radius;
            let step = f.abs().min(far - t);
            let facing = dot(x, d).abs() / length(x);
            let s = f.abs() + self.bounds * (settings.lambda_d * facing + settings.epsilon);
            let raw = s.powf(-settings.gamma) * step;
            visits.push(Visit { t, x, raw, weight: 0.0 });
            if f >= far - t {
                break;
            }
            t += f;
        }
        set_weights(&mut visits, settings.top_k);
        visits
    }

    /// J = ∂u/∂x at a point: two rows, in pixels per world unit.
    fn jacobian(&self, x: Vector) -> [Vector; 2] {
        let r = plus(x, -1.0, self.eye());
        let depth = dot(r, FORWARD);
        AXES.map(|axis| times(self.focal / depth, plus(axis, -dot(axis, r) / depth, FORWARD)))
    }

    /// The warp field V at a film position, in pixels per unit of the parameter.
    pub(super) fn warp(&self, u: Film, parameter: Parameter, settings: &Settings) -> Film {
        let mut v = [0.0; 2];
        for Visit { x, weight, .. } in self.visits(u, settings) {
            let m = times(length(x).recip(), x);
            let f_dot = match parameter {
                Parameter::Radius => -1.0,
                Parameter::Center(axis) => -m[axis],
            };
            for (v, row) in v.iter_mut().zip(self.jacobian(x)) {
                *v -= weight * dot(row, m) * f_dot;
            }
        }
        v
    }
}

/// The k largest weights, less the smallest of them, divided by their sum. A ray with fewer points
/// has the floor 0.
fn set_weights(visits: &mut [Visit], k: usize) {
    let mut sorted: Vec<f64> = visits.iter().map(|visit| visit.raw).collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let floor = if sorted.len() >= k { sorted[k - 1] } else { 0.0 };
    let sum: f64 = sorted.iter().map(|raw| (raw - floor).max(0.0)).sum();
    visits.iter_mut().for_each(|visit| visit.weight = (visit.raw - floor).max(0.0) / sum);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_velocity_of_the_outline_is_that_of_differences() {
        let h = 1e-6;
        let moved = |radius: f64, distance: f64| {
            Ball { radius: 0.7 + radius, distance: 4.0 + distance, ..BALL }.outline()
        };
        let by_radius = (moved(h, 0.0) - moved(-h, 0.0)) / (2.0 * h);
        let along = (moved(0.0, -h) - moved(0.0, h)) / (2.0 * h);
        let right = [1.0, 0.0];
        assert!((BALL.velocity(Parameter::Radius, right) / by_radius - 1.0).abs() < 1e-8);
        assert!((BALL.velocity(Parameter::Center(2), right) / along - 1.0).abs() < 1e-8);
        // The film's y axis points down.
        let across = BALL.velocity(Parameter::Center(0), right);
        assert_eq!(BALL.velocity(Parameter::Center(1), [0.0, -1.0]), across);
        // The outline is the set of rays with m = 0.
        assert!(BALL.closest([8.0 + BALL.outline(), 8.0]).0.abs() < 1e-12);
    }

    #[test]
    fn the_warp_tends_to_the_velocity_of_the_outline_as_the_points_grow() {
        let u = [8.0 + BALL.outline() + 1e-6, 8.0];
        for parameter in [Parameter::Radius, Parameter::Center(0), Parameter::Center(2)] {
            let exact = BALL.velocity(parameter, [1.0, 0.0]);
            let error = |points| {
                let settings = Settings { points, top_k: points + 1, ..SETTINGS };
                (BALL.warp(u, parameter, &settings)[0] / exact - 1.0).abs()
            };
            assert!(error(600) < 0.06 && error(600) <= error(22));
        }
    }
}
