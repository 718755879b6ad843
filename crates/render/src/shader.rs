//! Shaders: radiance that leaves a surface point, and its derivatives.

use field::{Dual, Field, Real, Scalar, Sphere, SurfaceAdjoint, SurfaceBatch, Vector3};
use sdf_nn::RadianceHead;

/// The precisions that scenes and networks are evaluated in.
pub trait Precision: Real + Scalar<Real = Self> + sdf_nn::Lane {}
impl<R: Real + Scalar<Real = R> + sdf_nn::Lane> Precision for R {}

/// Radiance at surface points, over batches: a function of the point x, the unit normal n and the
/// unit view direction d (from the camera to the point), with parameters of its own. Vectors of
/// colour are linear RGB.
pub trait Shader<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// Whether radiance is the same at every point in every direction, whatever the parameters.
    fn is_uniform(&self) -> bool {
        false
    }

    /// The radiance of every point.
    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]);

    /// VJP of (x, n, d; parameters) ↦ radiance: overwrites `bars`, adds to `parameters`.
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    );
}

impl<R: Precision> Shader<R> for RadianceHead<R> {
    fn parameter_count(&self) -> usize {
        self.parameters().len()
    }
    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        RadianceHead::radiance(self, points, rgb);
    }
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        RadianceHead::vjp(self, points, adjoint, bars, parameters);
    }
}

/// A light of a Lambertian scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Parallel light; the direction is towards the light, of any length.
    Directional,
    /// A point that falls off with the square of the distance.
    Point,
}

/// A closed form of radiance.
#[derive(Clone, Debug, PartialEq)]
pub enum Formula {
    /// The same radiance everywhere.
    Constant,
    /// albedo · (ambient + Σ light · max(0, n·l)).
    Lambert {
        /// The lights; their six numbers each stand behind albedo and ambient in the parameters.
        lights: Vec<Light>,
    },
    /// n/2 + 1/2.
    Normal,
}

/// The most lights that one scene may have: one bit each.
pub const MAX_LIGHTS: usize = 64;

/// No light is blocked.
const ALL_LIT: u64 = u64::MAX;

/// A shader in closed form; derivatives come from dual numbers through one formula.
pub struct Analytic<R> {
    /// The formula.
    pub formula: Formula,
    /// Its numbers.
    pub parameters: Vec<R>,
}

type V<S> = [S; 3];

fn dot<S: Scalar>(a: V<S>, b: V<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cosine and strength factor of a light at x.
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
    /// Radiance in any arithmetic; bit i of `lit` says whether light i reaches the point.
    fn shade<S: Scalar<Real = R>>(
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
    /// Adjoints of x and n; adds to the parameters'. The lights in `lit` reach the point.
    fn point_vjp(
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
        for p in 0..points.len() {
            [bars.x[p], bars.normal[p]] =
                self.point_vjp(points.x[p], points.normal[p], ALL_LIT, adjoint[p], parameters);
        }
    }
}

/// A Lambertian shader whose lights the solid itself blocks. Its derivatives hold visibility fixed.
pub struct Shadowed<'a, R: Real> {
    /// The shader without shadows.
    pub analytic: Analytic<R>,
    /// What blocks the light.
    pub occluders: &'a dyn Field<R>,
    /// Where it does.
    pub bounds: Sphere<R>,
}

/// How far above its surface a shadow ray starts, as a fraction of the bounding radius: above the
/// hit's error in single precision, below what a picture shows.
const SHADOW_OFFSET: f64 = 1e-3;

impl<R: Precision> Shadowed<'_, R> {
    /// Which lights reach each point, one bit a light.
    fn lit(&self, x: &[R::Vec3], n: &[R::Vec3]) -> Vec<u64> {
        let Formula::Lambert { lights } = &self.analytic.formula else {
            return vec![ALL_LIT; x.len()];
        };
        let mut lit = vec![0; x.len()];
        let offset = self.bounds.radius * <R as Real>::of(SHADOW_OFFSET);
        for (l, light) in lights.iter().enumerate() {
            let p = &self.analytic.parameters[6 + 6 * l..];
            let p = R::Vec3::new(p[0], p[1], p[2]);
            let (mut rays, mut owners, mut found) = (Vec::new(), Vec::new(), Vec::new());
            for (i, (x, n)) in x.iter().zip(n).enumerate() {
                let origin = *x + *n * offset;
                let to_light = if *light == Light::Point { p - origin } else { p };
                let direction = to_light * (R::one() / to_light.length());
                lit[i] |= 1 << l;
                if n.dot(direction) > R::zero()
                    && let Some(mut ray) = trace::Ray::enter(origin, direction, &self.bounds)
                {
                    if *light == Light::Point {
                        ray.far = Scalar::min(ray.far, to_light.length());
                    }
                    rays.push(ray);
                    owners.push(i);
                }
            }
            trace::intersect(self.occluders, &rays, &trace::Options::default(), &mut found);
            for (i, found) in owners.into_iter().zip(found) {
                if found.outcome != trace::Outcome::Miss {
                    lit[i] &= !(1 << l);
                }
            }
        }
        lit
    }
}

impl<R: Precision> Shader<R> for Shadowed<'_, R> {
    fn parameter_count(&self) -> usize {
        self.analytic.parameter_count()
    }

    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        let SurfaceBatch { x, normal: n, .. } = *points;
        let parameters = &self.analytic.parameters;
        for (i, lit) in self.lit(x, n).into_iter().enumerate() {
            let shaded =
                self.analytic.shade(|p| parameters[p], x[i].to_array(), n[i].to_array(), lit);
            rgb[i] = R::Vec3::from_array(shaded);
        }
    }

    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        let SurfaceBatch { x, normal: n, .. } = *points;
        bars.direction.fill(R::Vec3::zero());
        for (p, lit) in self.lit(x, n).into_iter().enumerate() {
            [bars.x[p], bars.normal[p]] =
                self.analytic.point_vjp(x[p], n[p], lit, adjoint[p], parameters);
        }
    }
}
