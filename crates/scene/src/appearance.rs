//! The `appearance` part of a scene: how a surface looks.

use std::path::{Path, PathBuf};

use field::{Field, Real, Sphere};
use io::InputError;
use io::json::Object;
use render::{Analytic, Formula, Light, MAX_LIGHTS, Precision, Shader, Shadowed};
use sdf_nn::RadianceHead;

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
                let bytes = std::fs::read(&path)
                    .map_err(|e| InputError::new(&path, "weights", e, "a model file"))?;
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
    pub fn build<'a, R: Precision>(
        &self,
        occluders: &'a dyn Field<R>,
        bounds: Sphere<R>,
    ) -> Result<Box<dyn Shader<R> + 'a>> {
        if let Some(head) = head(&self.appearance)? {
            return Ok(Box::new(head));
        }
        let parameters = self.parameters.iter().map(|&p| <R as Real>::of(p)).collect();
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
}

fn head<R: Precision>(appearance: &Appearance) -> Result<Option<RadianceHead<R>>> {
    let Appearance::Neural { path, bytes } = appearance else { return Ok(None) };
    let head = RadianceHead::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a model file of a radiance head"))?;
    Ok(Some(head))
}
#[cfg(test)]
#[path = "appearance_tests.rs"]
mod tests;
