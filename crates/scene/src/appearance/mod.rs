//! The `appearance` object of a scene file: the radiance of the surface.

#![warn(clippy::cast_possible_truncation)]

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use field::{Field, Real, Sphere};
use field::{Precision, Shader};
use files::InputError;
use files::json::Object;
use glam::DVec3;
use render::{Analytic, Formula, Light, MAX_LIGHTS, Shadowed};
use sdf_nn::{Passes, RadianceHead};

type Result<T> = std::result::Result<T, InputError>;

/// The kind of an appearance in a scene file.
#[derive(Clone, Debug, PartialEq)]
pub enum Appearance {
    /// The same radiance everywhere.
    Constant,
    /// Lambertian reflection: albedo · (ambient + Σ light · max(0, n·l)), without 1/π.
    Lambert {
        /// The lights. Each has six parameters, after the three of albedo and three of ambient:
        /// direction and radiance, or position and intensity.
        lights: Vec<Light>,
        /// Whether the solid blocks lights. A blocked light has no derivative, and the motion of a
        /// shadow's edge is not differentiated.
        shadows: bool,
    },
    /// The unit normal as a colour: n/2 + 1/2.
    Normal,
    /// A radiance head: a network of point, normal and view direction.
    Neural {
        /// The model file.
        path: PathBuf,
        /// The bytes of the model file.
        bytes: Vec<u8>,
    },
}

/// An appearance with its parameters and their JSON pointers.
#[derive(Clone, Debug, PartialEq)]
pub struct AppearanceModel {
    /// The kind, which gives the parameters their meaning.
    pub appearance: Appearance,
    /// The numbers of the file, in the order of the shader's parameters. Empty for a network.
    pub parameters: Vec<f64>,
    /// The JSON pointer of each parameter.
    pub pointers: Vec<String>,
}

/// Parameters and their JSON pointers, as they are read.
#[derive(Default)]
struct Parameters {
    values: Vec<f64>,
    pointers: Vec<String>,
}

impl Parameters {
    /// Appends a vector of any size: a direction or a position.
    fn vector(&mut self, object: &Object<'_>, key: &'static str) -> Result<()> {
        self.push(object, key, object.numbers(key)?);
        Ok(())
    }

    /// Appends a colour: an albedo, a radiance or an intensity, limited to 1e30.
    fn color(&mut self, object: &Object<'_>, key: &'static str) -> Result<()> {
        self.push(object, key, object.light(key)?);
        Ok(())
    }

    fn push(&mut self, object: &Object<'_>, key: &str, values: [f64; 3]) {
        self.values.extend(values);
        self.pointers.extend((0..3).map(|i| format!("{}/{i}", object.pointer(key))));
    }
}

impl AppearanceModel {
    /// Reads the object. Relative paths of model files start at `folder`.
    pub(crate) fn read(object: Object<'_>, folder: &Path) -> Result<Self> {
        let mut parameters = Parameters::default();
        let appearance = match object.string("type")? {
            "constant" => {
                parameters.color(&object, "radiance")?;
                Appearance::Constant
            }
            "lambert" => read_lambert(&object, &mut parameters)?,
            "normal" => Appearance::Normal,
            "neural" => read_head(&object, folder)?,
            _ => return Err(object.error("type", "constant, lambert, normal or neural")),
        };
        object.finish()?;
        let Parameters { values, pointers } = parameters;
        Ok(AppearanceModel { appearance, parameters: values, pointers })
    }

    /// Builds the shader in single or double precision, for points relative to `origin`, in world
    /// units.
    ///
    /// If the appearance has shadows, the field `occluders` blocks lights within `bounds`, in world
    /// units. Both are unused otherwise.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub(crate) fn build<'a, R: Precision + Passes>(
        &self,
        origin: DVec3,
        occluders: &'a dyn Field<R>,
        bounds: Sphere<R>,
    ) -> Result<Box<dyn Shader<R> + 'a>> {
        if let Some(head) = radiance_head(&self.appearance)? {
            return Ok(Box::new(head.about(origin)));
        }
        let parameters = self.parameters_about(origin).map(<R as Real>::of).collect();
        let formula = match &self.appearance {
            Appearance::Lambert { lights, .. } => Formula::Lambert { lights: lights.clone() },
            Appearance::Normal => Formula::Normal,
            Appearance::Constant | Appearance::Neural { .. } => Formula::Constant,
        };
        let analytic = Analytic { formula, parameters };
        Ok(match self.appearance {
            Appearance::Lambert { shadows: true, .. } => {
                Box::new(Shadowed { analytic, occluders, bounds })
            }
            _ => Box::new(analytic),
        })
    }

    /// The parameters, with the positions of lights relative to `origin`.
    fn parameters_about(&self, origin: DVec3) -> impl Iterator<Item = f64> {
        let mut parameters = self.parameters.clone();
        if let Appearance::Lambert { lights, .. } = &self.appearance {
            for (light, values) in lights.iter().zip(parameters[6..].chunks_mut(6)) {
                if *light == Light::Point {
                    values.iter_mut().zip(origin.to_array()).for_each(|(v, o)| *v -= o);
                }
            }
        }
        parameters.into_iter()
    }
}

fn read_lambert(object: &Object<'_>, parameters: &mut Parameters) -> Result<Appearance> {
    parameters.color(object, "albedo")?;
    parameters.color(object, "ambient")?;
    let lights: Result<Vec<Light>> = object
        .objects("lights", false)?
        .into_iter()
        .map(|light| read_light(light, parameters))
        .collect();
    let lights = lights?;
    if lights.len() > MAX_LIGHTS {
        return Err(object.error("lights", "at most 64 lights"));
    }
    Ok(Appearance::Lambert { lights, shadows: object.boolean("shadows", false)? })
}

fn read_light(light: Object<'_>, parameters: &mut Parameters) -> Result<Light> {
    let kind = match light.string("type")? {
        "directional" => {
            // Refuses the zero vector; the parameters keep the direction at its own length.
            light.direction("direction")?;
            parameters.vector(&light, "direction")?;
            parameters.color(&light, "radiance")?;
            Light::Directional
        }
        "point" => {
            parameters.vector(&light, "position")?;
            parameters.color(&light, "intensity")?;
            Light::Point
        }
        _ => return Err(light.error("type", "directional or point")),
    };
    light.finish()?;
    Ok(kind)
}

/// Reads a model file and checks that it describes a radiance head.
fn read_head(object: &Object<'_>, folder: &Path) -> Result<Appearance> {
    let path = folder.join(object.string("weights")?);
    let bytes = files::read(&path, "weights", "a model file")?;
    let appearance = Appearance::Neural { path, bytes };
    radiance_head::<f32>(&appearance)?;
    Ok(appearance)
}

/// The network of a neural appearance; `None` for the others.
fn radiance_head<R: Precision + Passes>(
    appearance: &Appearance,
) -> Result<Option<RadianceHead<R>>> {
    let Appearance::Neural { path, bytes } = appearance else { return Ok(None) };
    let head = RadianceHead::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a model file of a radiance head"))?;
    Ok(Some(head))
}
