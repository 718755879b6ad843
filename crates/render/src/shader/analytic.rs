//! Shaders in closed form: constant radiance, Lambertian reflection, and the normal as a colour.

use field::{Dual, Precision, Real, Scalar, Shader, SurfaceAdjoint, SurfaceBatch, Vector3};

/// A light of a Lambertian scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Parallel light. Its direction points towards the light and may have any length.
    Directional,
    /// A point whose light falls off with the square of the distance.
    Point,
}

/// A closed form of the radiance at a surface point.
#[derive(Clone, Debug, PartialEq)]
pub enum Formula {
    /// The same radiance everywhere. Parameters: the radiance, 3 numbers.
    Constant,
    /// albedo · (ambient + Σ light · max(0, n·l)), without the factor 1/π.
    ///
    /// Parameters: albedo, ambient, then 6 numbers per light: its direction or position, and its
    /// radiance or intensity.
    Lambert {
        /// The lights, at most [`MAX_LIGHTS`].
        lights: Vec<Light>,
    },
    /// n/2 + 1/2 for the unit normal n. No parameters.
    Normal,
}

/// The largest number of lights of a scene: masks of lights have 64 bits.
pub const MAX_LIGHTS: usize = 64;

/// The mask of lights where all lights reach the point.
pub(super) const ALL_LIT: u64 = u64::MAX;

/// A shader in closed form. Its derivatives cost as much as a few evaluations, for any number of
/// parameters.
#[derive(Debug)]
pub struct Analytic<R> {
    /// The formula.
    pub formula: Formula,
    /// Its parameters, in the order that [`Formula`] gives.
    pub parameters: Vec<R>,
}

type V<S> = [S; 3];

fn dot<S: Scalar>(a: V<S>, b: V<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn times<S: Scalar>(a: V<S>, b: V<S>) -> V<S> {
    std::array::from_fn(|c| a[c] * b[c])
}

fn constant<S: Scalar>(value: f64) -> S {
    S::constant(S::Real::of(value))
}

/// The vector of three parameters from `start`.
fn at<S: Copy>(parameters: &[S], start: usize) -> V<S> {
    std::array::from_fn(|c| parameters[start + c])
}

/// Adds a vector to three numbers from `start`.
fn add<S: Scalar>(sums: &mut [S], start: usize, v: V<S>) {
    for (sum, v) in sums[start..].iter_mut().zip(v) {
        *sum = *sum + v;
    }
}

/// Independent variables: vector i has the directions from 3i.
fn variables<S: Scalar>(vectors: [V<S>; 3]) -> [V<Dual<S, 9>>; 3] {
    let variable = |i: usize| Dual::variable(vectors[i / 3][i % 3], i);
    std::array::from_fn(|v| std::array::from_fn(|c| variable(3 * v + c)))
}

/// The lights that are set in the mask `lit`, with their indices.
fn lit_lights(lights: &[Light], lit: u64) -> impl Iterator<Item = (usize, Light)> {
    lights.iter().copied().enumerate().filter(move |(i, _)| lit >> i & 1 == 1)
}

/// The factor of a light's strength at x: max(0, n·l), over the squared distance for a point light.
///
/// `p` is the direction or the position of the light.
fn incident<S: Scalar>(light: Light, p: V<S>, x: V<S>, n: V<S>) -> S {
    let zero = constant(0.0);
    match light {
        Light::Directional => (dot(n, p) / dot(p, p).sqrt()).max(zero),
        Light::Point => {
            let to_light: V<S> = std::array::from_fn(|i| p[i] - x[i]);
            let square = dot(to_light, to_light);
            (dot(n, to_light) / (square.sqrt() * square)).max(zero)
        }
    }
}

impl Formula {
    /// The radiance at x, in any arithmetic. Bit i of `lit` is set if light i reaches the point.
    #[inline]
    fn radiance<S: Scalar>(&self, parameters: &[S], x: V<S>, n: V<S>, lit: u64) -> V<S> {
        match self {
            Formula::Constant => at(parameters, 0),
            Formula::Normal => n.map(|c| (c + constant(1.0)) * constant(0.5)),
            Formula::Lambert { lights } => {
                let (albedo, mut arriving) = (at(parameters, 0), at(parameters, 3));
                for (i, light) in lit_lights(lights, lit) {
                    let factor = incident(light, at(parameters, 6 + 6 * i), x, n);
                    let strength = at(parameters, 9 + 6 * i);
                    arriving = std::array::from_fn(|c| arriving[c] + strength[c] * factor);
                }
                times(albedo, arriving)
            }
        }
    }

    /// VJP of (x, n; parameters) ↦ radiance, in any arithmetic: returns the adjoints of x and n,
    /// and adds those of the parameters to `bars`.
    ///
    /// The cost is one evaluation of each light, for all parameters together.
    fn vjp<S: Scalar>(
        &self,
        parameters: &[S],
        [x, n]: [V<S>; 2],
        lit: u64,
        adjoint: V<S>,
        bars: &mut [S],
    ) -> [V<S>; 2] {
        let zero = [constant(0.0); 3];
        let lights = match self {
            Formula::Constant => {
                add(bars, 0, adjoint);
                return [zero, zero];
            }
            Formula::Normal => return [zero, adjoint.map(|c| c * constant(0.5))],
            Formula::Lambert { lights } => lights,
        };
        // radiance = albedo · arriving, with arriving = ambient + Σ strength · factor(p, x, n).
        let of_arriving = times(adjoint, at(parameters, 0));
        let (mut arriving, mut x_bar, mut n_bar) = (at(parameters, 3), zero, zero);
        add(bars, 3, of_arriving);
        for (i, light) in lit_lights(lights, lit) {
            let strength = at(parameters, 9 + 6 * i);
            let [p, x, n] = variables([at(parameters, 6 + 6 * i), x, n]);
            let factor = incident(light, p, x, n);
            let of_factor = dot(of_arriving, strength);
            let by =
                |start: usize| -> V<S> { std::array::from_fn(|c| of_factor * factor.d[start + c]) };
            arriving = std::array::from_fn(|c| arriving[c] + strength[c] * factor.value);
            add(bars, 6 + 6 * i, by(0));
            add(bars, 9 + 6 * i, of_arriving.map(|c| c * factor.value));
            add(&mut x_bar, 0, by(3));
            add(&mut n_bar, 0, by(6));
        }
        add(bars, 0, times(adjoint, arriving));
        [x_bar, n_bar]
    }
}

impl<R: Precision> Analytic<R> {
    /// The radiance at one point. The lights in `lit` reach it.
    #[inline]
    pub(super) fn point_radiance(&self, x: R::Vec3, n: R::Vec3, lit: u64) -> R::Vec3 {
        let (x, n) = (x.to_array(), n.to_array());
        R::Vec3::from_array(self.formula.radiance(&self.parameters, x, n, lit))
    }

    /// VJP of (x, n; parameters) ↦ radiance at one point: returns the adjoints of x and n, and adds
    /// that of the parameters to `parameters`. The lights in `lit` reach the point.
    pub(super) fn point_vjp(
        &self,
        x: R::Vec3,
        n: R::Vec3,
        lit: u64,
        adjoint: R::Vec3,
        parameters: &mut [R],
    ) -> [R::Vec3; 2] {
        let at = [x.to_array(), n.to_array()];
        let adjoint = adjoint.to_array();
        self.formula.vjp(&self.parameters, at, lit, adjoint, parameters).map(R::Vec3::from_array)
    }
}

impl<R: Precision> Shader<R> for Analytic<R> {
    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn is_uniform(&self) -> bool {
        self.formula == Formula::Constant
    }

    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        for ((x, n), rgb) in points.x.iter().zip(points.normal).zip(rgb) {
            *rgb = self.point_radiance(*x, *n, ALL_LIT);
        }
    }

    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        bars.direction.fill(R::Vec3::zero());
        for (p, adjoint) in adjoint.iter().enumerate().take(points.len()) {
            [bars.x[p], bars.normal[p]] =
                self.point_vjp(points.x[p], points.normal[p], ALL_LIT, *adjoint, parameters);
        }
    }
}

#[cfg(test)]
#[path = "analytic_tests.rs"]
mod tests;
