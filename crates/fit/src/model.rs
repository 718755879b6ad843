//! The model of a fit: a signed distance network and a radiance head.

use std::path::Path;

use field::Sphere;
use glam::DVec3;
use io::{InputError, atomic_write};
use random::{Purpose, Stream};
use sdf_nn::{Activation, Architecture, Encoding, Network, RadianceHead, Transform};

use crate::options::FitOptions;

/// A signed distance network, and a network for the radiance on its surface.
#[derive(Clone, Debug)]
pub struct Model {
    /// The signed distance, in world units, negative inside.
    pub field: Network<f32>,
    /// The radiance, linear RGB.
    pub head: RadianceHead<f32>,
}

/// Width of the radiance head's hidden layers.
const HEAD_WIDTH: usize = 64;
/// Number of the radiance head's hidden layers.
const HEAD_LAYERS: usize = 3;
/// Octaves of the frequency encoding of the position in the radiance head.
pub(crate) const HEAD_BANDS: usize = 6;

impl Model {
    /// The model at the start of a fit: a sphere with a nearly uniform radiance.
    ///
    /// It is a function of the network's options, the seed and `bounds` (world units).
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
            Stream::new(options.seed, Purpose::InitialRadiance).bits(),
        );
        Model { field, head }
    }

    /// The parameters of the field, then those of the radiance head.
    pub fn parameters(&self) -> Vec<f32> {
        [self.field.parameters(), self.head.parameters()].concat()
    }

    /// Sets the parameters, in the order of [`parameters`](Self::parameters).
    ///
    /// # Panics
    /// If the number of parameters is wrong.
    pub fn set_parameters(&mut self, parameters: &[f32]) {
        let (field, head) = parameters.split_at(self.field.parameters().len());
        self.field.set_parameters(field);
        self.head.set_parameters(head);
    }

    /// Writes `model.safetensors` and `radiance.safetensors` into a run folder, in world units. The
    /// model is relative to `origin`.
    ///
    /// # Errors
    /// If a file cannot be written. A file that was there before then stays complete.
    pub fn save(&self, run: &Path, origin: DVec3) -> anyhow::Result<()> {
        let field = self.field.clone().about(-origin).to_safetensors()?;
        atomic_write(&run.join("model.safetensors"), |out| Ok(out.write_all(&field)?))?;
        let head = self.head.clone().about(-origin).to_safetensors()?;
        atomic_write(&run.join("radiance.safetensors"), |out| Ok(out.write_all(&head)?))
    }

    /// Reads the model of a run folder, for points relative to `origin`.
    ///
    /// # Errors
    /// If a file is missing or is not a model file.
    pub fn load(run: &Path, origin: DVec3) -> Result<Self, InputError> {
        let read = |name: &str| {
            let path = run.join(name);
            io::read(&path, "model", "the model file of a run")
        };
        let wrong = |name: &str, e: sdf_nn::ModelError| {
            InputError::new(run.join(name), "weights", e, "a model file")
        };
        let field: Network<f32> = Network::from_safetensors(&read("model.safetensors")?)
            .map_err(|e| wrong("model.safetensors", e))?;
        let head: RadianceHead<f32> =
            RadianceHead::from_safetensors(&read("radiance.safetensors")?)
                .map_err(|e| wrong("radiance.safetensors", e))?;
        Ok(Model { field: field.about(origin), head: head.about(origin) })
    }
}

/// The frequency encoding of `bands` octaves; none for 0.
pub(crate) fn encoding(bands: usize) -> Encoding {
    if bands == 0 { Encoding::None } else { Encoding::Frequency { bands } }
}
