//! The `appearance` part of a scene: radiance leaving a surface point, and its derivatives.

use std::path::{Path, PathBuf};

use field::{Dual, Field, Real, Scalar, Sphere, Vector3};
use sdf_nn::RadianceHead;

use super::Precision;
use super::reader::Object;
use crate::error::InputError;

/// Radiance at surface points, over batches: a function of the point x, the unit normal n and the unit view
/// direction d (from the camera to the point), with parameters of its own. Vectors of colour are linear RGB.
pub trait Shader<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// Whether radiance is the same at every point in every direction, whatever the parameters.
    fn is_uniform(&self) -> bool {
        false
    }

    /// The radiance of every point.
    fn radiance(&self, x: &[R::Vec3], n: &[R::Vec3], d: &[R::Vec3], rgb: &mut [R::Vec3]);

    /// VJP of (x, n, d; parameters) ↦ radiance: overwrites the adjoints of x, n and d, adds to the parameters'.
    #[allow(clippy::too_many_arguments, reason = "three inputs, one output, and an adjoint for each")]
    fn vjp(
        &self,
        x: &[R::Vec3],
        n: &[R::Vec3],
        d: &[R::Vec3],
        adjoint: &[R::Vec3],
        x_bar: &mut [R::Vec3],
        n_bar: &mut [R::Vec3],
        d_bar: &mut [R::Vec3],
        parameters: &mut [R],
    );
}

impl<R: Precision> Shader<R> for RadianceHead<R> {
    fn parameter_count(&self) -> usize {
        self.parameters().len()
    }
    fn radiance(&self, x: &[R::Vec3], n: &[R::Vec3], d: &[R::Vec3], rgb: &mut [R::Vec3]) {
        RadianceHead::radiance(self, x, n, d, rgb);
    }
    fn vjp(
        &self,
        x: &[R::Vec3],
        n: &[R::Vec3],
        d: &[R::Vec3],
        adjoint: &[R::Vec3],
        x_bar: &mut [R::Vec3],
        n_bar: &mut [R::Vec3],
        d_bar: &mut [R::Vec3],
        parameters: &mut [R],
    ) {
        RadianceHead::vjp(self, x, n, d, adjoint, x_bar, n_bar, d_bar, parameters);
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

/// An appearance as a scene file describes it.
#[derive(Clone, Debug, PartialEq)]
pub enum Appearance {
    /// The same radiance everywhere.
    Constant,
    /// albedo · (ambient + Σ light · max(0, n·l)).
    Lambert {
        /// The lights; their six numbers each stand behind albedo and ambient in the parameters.
        lights: Vec<Light>,
        /// Whether lights are blocked by the solid (rendering only).
        shadows: bool,
    },
    /// n/2 + 1/2.
    Normal,
    /// A network, from the bytes of its file.
    Neural {
        /// The file.
        path: PathBuf,
        /// Its content.
        bytes: Vec<u8>,
    },
}

/// An appearance with its numbers and their JSON pointers.
#[derive(Clone, Debug, PartialEq)]
pub struct AppearanceModel {
    /// What the numbers mean.
    pub appearance: Appearance,
    /// The numbers, in the order of the shader's parameters.
    pub parameters: Vec<f64>,
    /// The JSON pointer of each number.
    pub pointers: Vec<String>,
}

type Result<T> = std::result::Result<T, InputError>;

impl AppearanceModel {
    /// Reads the object; relative paths of model files start at `folder`.
    pub(crate) fn read(object: Object<'_>, folder: &Path) -> Result<Self> {
        let (mut parameters, mut pointers) = (Vec::new(), Vec::new());
        let mut take = |object: &Object<'_>, key: &'static str| -> Result<()> {
            let place = matches!(key, "direction" | "position");
            parameters.extend(if place { object.numbers(key)? } else { object.light(key)? });
            pointers.extend((0..3).map(|i| format!("{}/{i}", object.pointer(key))));
            Ok(())
        };
        let appearance = match object.string("type")? {
            "constant" => {
                take(&object, "radiance")?;
                Appearance::Constant
            }
            "lambert" => {
                take(&object, "albedo")?;
                take(&object, "ambient")?;
                let mut lights = Vec::new();
                for light in object.objects("lights", false)? {
                    lights.push(match light.string("type")? {
                        "directional" => {
                            light.direction("direction")?;
                            take(&light, "direction")?;
                            take(&light, "radiance")?;
                            Light::Directional
                        }
                        "point" => {
                            take(&light, "position")?;
                            take(&light, "intensity")?;
                            Light::Point
                        }
                        _ => return Err(light.error("type", "directional or point")),
                    });
                    light.finish()?;
                }
                if lights.len() > MAX_LIGHTS {
                    return Err(object.error("lights", "at most 64 lights"));
                }
                Appearance::Lambert { lights, shadows: object.boolean("shadows", false)? }
            }
            "normal" => Appearance::Normal,
            "neural" => {
                let path = folder.join(object.string("weights")?);
                let bytes = std::fs::read(&path).map_err(|e| InputError::new(&path, "weights", e, "a model file"))?;
                let appearance = Appearance::Neural { path, bytes };
                head::<f32>(&appearance)?;
                appearance
            }
            _ => return Err(object.error("type", "constant, lambert, normal or neural")),
        };
        object.finish()?;
        Ok(AppearanceModel { appearance, parameters, pointers })
    }

    /// Builds the shader in a precision.
    ///
    /// # Errors
    /// If a model file cannot be used.
    ///
    /// With shadows, `occluders` blocks light within `bounds`.
    pub(crate) fn build<'a, R: Precision>(
        &self,
        occluders: &'a dyn Field<R>,
        bounds: Sphere<R>,
    ) -> Result<Box<dyn Shader<R> + 'a>> {
        if let Some(head) = head(&self.appearance)? {
            return Ok(Box::new(head));
        }
        let parameters = self.parameters.iter().map(|&p| <R as Real>::of(p)).collect();
        let analytic = Analytic { appearance: self.appearance.clone(), parameters };
        Ok(match self.appearance {
            Appearance::Lambert { shadows: true, .. } => Box::new(Shadowed { analytic, occluders, bounds }),
            _ => Box::new(analytic),
        })
    }
}

fn head<R: Precision>(appearance: &Appearance) -> Result<Option<RadianceHead<R>>> {
    let Appearance::Neural { path, bytes } = appearance else { return Ok(None) };
    let head = RadianceHead::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a model file of a radiance head"))?;
    Ok(Some(head))
}

/// The most lights a scene may have: one bit each.
const MAX_LIGHTS: usize = 64;

/// No light is blocked.
const ALL_LIT: u64 = u64::MAX;

/// A shader in closed form; derivatives come from dual numbers through one formula.
struct Analytic<R> {
    appearance: Appearance,
    parameters: Vec<R>,
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
    fn shade<S: Scalar<Real = R>>(&self, parameter: impl Fn(usize) -> S, x: V<S>, n: V<S>, lit: u64) -> V<S> {
        let at = |i: usize| -> V<S> { std::array::from_fn(|c| parameter(i + c)) };
        match &self.appearance {
            Appearance::Constant | Appearance::Neural { .. } => at(0),
            Appearance::Normal => n.map(|c| (c + S::constant(R::one())) * S::constant(<R as Real>::of(0.5))),
            Appearance::Lambert { lights, .. } => {
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
    fn point_vjp(&self, x: R::Vec3, n: R::Vec3, lit: u64, adjoint: R::Vec3, parameters: &mut [R]) -> [R::Vec3; 2] {
        let (at, normal) = (x.to_array(), n.to_array());
        for (j, out) in parameters.iter_mut().enumerate() {
            let parameter = |i: usize| {
                let value = self.parameters[i];
                if i == j { Dual::<R, 1>::variable(value, 0) } else { Dual::lift(value) }
            };
            let rgb = self.shade(parameter, at.map(Dual::lift), normal.map(Dual::lift), lit);
            *out += R::Vec3::from_array(rgb.map(|c| c.d[0])).dot(adjoint);
        }
        let seed = |v: V<R>, start: usize| std::array::from_fn(|i| Dual::<R, 6>::variable(v[i], start + i));
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
        self.appearance == Appearance::Constant
    }

    fn radiance(&self, x: &[R::Vec3], n: &[R::Vec3], _: &[R::Vec3], rgb: &mut [R::Vec3]) {
        for ((x, n), rgb) in x.iter().zip(n).zip(rgb) {
            *rgb = R::Vec3::from_array(self.shade(|i| self.parameters[i], x.to_array(), n.to_array(), ALL_LIT));
        }
    }

    fn vjp(
        &self,
        x: &[R::Vec3],
        n: &[R::Vec3],
        _: &[R::Vec3],
        adjoint: &[R::Vec3],
        x_bar: &mut [R::Vec3],
        n_bar: &mut [R::Vec3],
        d_bar: &mut [R::Vec3],
        parameters: &mut [R],
    ) {
        d_bar.fill(R::Vec3::zero());
        for p in 0..x.len() {
            [x_bar[p], n_bar[p]] = self.point_vjp(x[p], n[p], ALL_LIT, adjoint[p], parameters);
        }
    }
}

/// A Lambertian shader whose lights the solid itself blocks. Its derivatives hold visibility fixed.
struct Shadowed<'a, R: Real> {
    analytic: Analytic<R>,
    occluders: &'a dyn Field<R>,
    bounds: Sphere<R>,
}

/// How far above its surface a shadow ray starts, as a fraction of the bounding radius: above the hit's error in single
/// precision, below what a picture shows.
const SHADOW_OFFSET: f64 = 1e-3;

impl<R: Precision> Shadowed<'_, R> {
    /// Which lights reach each point, one bit a light.
    fn lit(&self, x: &[R::Vec3], n: &[R::Vec3]) -> Vec<u64> {
        let Appearance::Lambert { lights, .. } = &self.analytic.appearance else { return vec![ALL_LIT; x.len()] };
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

    fn radiance(&self, x: &[R::Vec3], n: &[R::Vec3], _: &[R::Vec3], rgb: &mut [R::Vec3]) {
        let parameters = &self.analytic.parameters;
        for (i, lit) in self.lit(x, n).into_iter().enumerate() {
            let shaded = self.analytic.shade(|p| parameters[p], x[i].to_array(), n[i].to_array(), lit);
            rgb[i] = R::Vec3::from_array(shaded);
        }
    }

    fn vjp(
        &self,
        x: &[R::Vec3],
        n: &[R::Vec3],
        _: &[R::Vec3],
        adjoint: &[R::Vec3],
        x_bar: &mut [R::Vec3],
        n_bar: &mut [R::Vec3],
        d_bar: &mut [R::Vec3],
        parameters: &mut [R],
    ) {
        d_bar.fill(R::Vec3::zero());
        for (p, lit) in self.lit(x, n).into_iter().enumerate() {
            [x_bar[p], n_bar[p]] = self.analytic.point_vjp(x[p], n[p], lit, adjoint[p], parameters);
        }
    }
}

#[cfg(test)]
#[path = "appearance_tests.rs"]
mod tests;
