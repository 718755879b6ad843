//! Shaders in closed form: constant radiance, Lambertian reflection, and the normal as a colour.

use field::{Dual, Real, Scalar, SurfaceAdjoint, SurfaceBatch, Vector3};

use super::shaded::{Precision, Shader};

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

/// A shader in closed form. Its derivatives are those of the same formula in dual numbers.
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

/// The factor of a light's strength at x: max(0, n·l), over the squared distance for a point light.
///
/// `p` is the direction or the position of the light.
fn incident<S: Scalar>(light: Light, p: V<S>, x: V<S>, n: V<S>) -> S {
    let zero = S::constant(S::Real::of(0.0));
    match light {
        Light::Directional => (dot(n, p) / dot(p, p).sqrt()).max(zero),
        Light::Point => {
            let to_light: V<S> = std::array::from_fn(|i| p[i] - x[i]);
            let square = dot(to_light, to_light);
            (dot(n, to_light) / (square.sqrt() * square)).max(zero)
        }
    }
}

impl<R: Precision> Analytic<R> {
    /// The radiance at x, in any arithmetic. Bit i of `lit` is set if light i reaches the point.
    pub(super) fn shade<S: Scalar<Real = R>>(
        &self,
        parameter: impl Fn(usize) -> S,
        x: V<S>,
        n: V<S>,
        lit: u64,
    ) -> V<S> {
        let at = |i: usize| -> V<S> { std::array::from_fn(|c| parameter(i + c)) };
        match &self.formula {
            Formula::Constant => at(0),
            Formula::Normal => {
                n.map(|c| (c + S::constant(R::one())) * S::constant(<R as Real>::of(0.5)))
            }
            Formula::Lambert { lights } => {
                let (albedo, mut arriving) = (at(0), at(3));
                for (i, light) in lights.iter().enumerate().filter(|(i, _)| lit >> i & 1 == 1) {
                    let factor = incident(*light, at(6 + 6 * i), x, n);
                    let strength = at(9 + 6 * i);
                    arriving = std::array::from_fn(|c| arriving[c] + strength[c] * factor);
                }
                std::array::from_fn(|c| albedo[c] * arriving[c])
            }
        }
    }
}

impl<R: Precision> Analytic<R> {
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
        let (at, normal) = (x.to_array(), n.to_array());
        for (j, out) in parameters.iter_mut().enumerate() {
            let parameter = |i: usize| {
                let value = self.parameters[i];
                if i == j { Dual::<R, 1>::variable(value, 0) } else { Dual::lift(value) }
            };
            let rgb = self.shade(parameter, at.map(Dual::lift), normal.map(Dual::lift), lit);
            *out += R::Vec3::from_array(rgb.map(|c| c.d[0])).dot(adjoint);
        }
        let seed = |v: V<R>, start: usize| {
            std::array::from_fn(|i| Dual::<R, 6>::variable(v[i], start + i))
        };
        let rgb = self.shade(|i| Dual::lift(self.parameters[i]), seed(at, 0), seed(normal, 3), lit);
        let along = |j: usize| R::Vec3::from_array(rgb.map(|c| c.d[j])).dot(adjoint);
        [R::Vec3::new(along(0), along(1), along(2)), R::Vec3::new(along(3), along(4), along(5))]
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
            *rgb = R::Vec3::from_array(self.shade(
                |i| self.parameters[i],
                x.to_array(),
                n.to_array(),
                ALL_LIT,
            ));
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
