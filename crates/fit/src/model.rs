//! What a fit optimises, and the files of a run folder.

use std::path::{Path, PathBuf};

use field::Sphere;
use glam::DVec3;
use sdf_nn::{Activation, Architecture, Encoding, Network, RadianceHead, Transform};
use serde::{Deserialize, Serialize};

use super::FitOptions;
use super::pyramid::Backdrop;
use dataset::Background;
use io::InputError;
use io::atomic_write;

/// A signed distance network with the radiance on its surface.
#[derive(Clone, Debug)]
pub struct Model {
    /// The signed distance.
    pub field: Network<f32>,
    /// The radiance.
    pub head: RadianceHead<f32>,
}

/// Width of the radiance head's hidden layers.
const HEAD_WIDTH: usize = 64;
/// Number of the radiance head's hidden layers.
const HEAD_LAYERS: usize = 3;
/// Octaves of the radiance head's encoding of the position.
pub(crate) const HEAD_BANDS: usize = 6;

/// `fit.toml`: all that a run was given, so that it can go on and be evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The data set's folder.
    pub dataset: PathBuf,
    /// The bounding sphere: centre and radius, in the data set's units.
    pub bounds: [f64; 4],
    /// Linear RGB of the background.
    pub background: [f32; 3],
    /// The robust standard deviation of the background in display space.
    pub background_spread: f32,
    /// How far the background is to be trusted, 0 to 1.
    pub background_confidence: f32,
    /// The options.
    pub options: FitOptions,
}

impl RunFile {
    /// The bounding sphere.
    pub fn sphere(&self) -> Sphere<f64> {
        let [x, y, z, radius] = self.bounds;
        Sphere { center: DVec3::new(x, y, z), radius }
    }

    /// The background.
    pub fn background(&self) -> Background {
        Background {
            color: self.background,
            spread: self.background_spread,
            confidence: self.background_confidence,
        }
    }

    /// What tells of the background.
    pub(crate) fn backdrop(&self) -> Backdrop {
        Backdrop {
            bounds: self.sphere(),
            background: self.background(),
            use_masks: self.options.use_masks,
        }
    }

    /// Reads `fit.toml` of a run folder.
    ///
    /// # Errors
    /// If the folder is not a run, or the file is wrong.
    pub fn load(run: &Path) -> Result<Self, InputError> {
        let path = run.join("fit.toml");
        let text = std::fs::read_to_string(&path)
            .map_err(|e| InputError::new(&path, "run", e, "the folder of a fit"))?;
        let file: RunFile = toml::from_str(&text)
            .map_err(|e| InputError::new(&path, "fit.toml", e.message(), "the options of a fit"))?;
        let sphere = file.sphere();
        if !(sphere.center.is_finite() && sphere.radius.is_finite() && sphere.radius > 0.0) {
            let found = format!("{:?}", file.bounds);
            return Err(InputError::new(&path, "bounds", found, "x, y, z and a radius above 0"));
        }
        Ok(file)
    }

    /// Writes `fit.toml` of a run folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, run: &Path) -> anyhow::Result<()> {
        let text = toml::to_string(self)?;
        atomic_write(&run.join("fit.toml"), |out| Ok(out.write_all(text.as_bytes())?))
    }
}

impl Model {
    /// The model a fit starts from: a sphere, and a nearly uniform radiance.
    pub fn initial(options: &FitOptions, bounds: &Sphere<f64>) -> Self {
        let transform = Transform { center: bounds.center, radius: bounds.radius };
        let architecture = Architecture {
            encoding: encoding(options.bands),
            hidden: vec![options.width; options.layers],
            skip: Vec::new(),
            activation: Activation::Softplus { beta: options.beta },
        };
        let field =
            Network::geometric(architecture, transform, options.initial_radius, options.seed);
        let hidden = vec![HEAD_WIDTH; HEAD_LAYERS];
        let head = RadianceHead::new(
            encoding(HEAD_BANDS),
            hidden,
            Activation::Relu,
            transform,
            options.seed ^ 1,
        );
        Model { field, head }
    }

    /// All parameters: the field's, then the head's.
    pub fn parameters(&self) -> Vec<f32> {
        [self.field.parameters(), self.head.parameters()].concat()
    }

    /// Sets all parameters.
    pub fn set_parameters(&mut self, parameters: &[f32]) {
        let (field, head) = parameters.split_at(self.field.parameters().len());
        self.field.set_parameters(field);
        self.head.set_parameters(head);
    }

    /// Writes `model.safetensors`, `radiance.safetensors` and a scene file for each training
    /// camera's kind into a run.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn save(&self, run: &Path) -> anyhow::Result<()> {
        let field = self.field.to_safetensors()?;
        atomic_write(&run.join("model.safetensors"), |out| Ok(out.write_all(&field)?))?;
        let head = self.head.to_safetensors()?;
        atomic_write(&run.join("radiance.safetensors"), |out| Ok(out.write_all(&head)?))
    }

    /// Reads the model of a run folder.
    ///
    /// # Errors
    /// If a file is missing or wrong.
    pub fn load(run: &Path) -> Result<Self, InputError> {
        let read = |name: &str| {
            let path = run.join(name);
            std::fs::read(&path)
                .map_err(|e| InputError::new(&path, "model", e, "a model file of a run"))
        };
        let wrong = |name: &str, e: sdf_nn::ModelError| {
            InputError::new(run.join(name), "weights", e, "a model file")
        };
        let field = Network::from_safetensors(&read("model.safetensors")?)
            .map_err(|e| wrong("model.safetensors", e))?;
        let head = RadianceHead::from_safetensors(&read("radiance.safetensors")?)
            .map_err(|e| wrong("radiance.safetensors", e))?;
        Ok(Model { field, head })
    }
}

fn encoding(bands: usize) -> Encoding {
    if bands == 0 { Encoding::None } else { Encoding::Frequency { bands } }
}
