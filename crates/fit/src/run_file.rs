//! The file `fit.toml` of a run folder.

use std::path::{Path, PathBuf};

use dataset::Background;
use field::Sphere;
use glam::DVec3;
use io::{InputError, atomic_write};
use serde::{Deserialize, Serialize};

use crate::background::BackgroundModel;
use crate::options::FitOptions;

/// The content of `fit.toml`: the input of a run. Resuming and evaluating a run read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The folder of the data set.
    pub dataset: PathBuf,
    /// The centre x, y, z and the radius of the bounding sphere, in the units of the data set.
    pub bounds: [f64; 4],
    /// The radiance of the background, linear RGB.
    pub background: [f32; 3],
    /// A robust standard deviation of the background, in display units.
    pub background_spread: f32,
    /// The confidence that the photographs have a uniform background, 0 to 1.
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

    /// The model that tells background pixels from pixels of the object.
    pub(crate) fn background_model(&self) -> BackgroundModel {
        BackgroundModel {
            bounds: self.sphere(),
            background: self.background(),
            use_masks: self.options.use_masks,
        }
    }

    /// Reads the `fit.toml` of a run folder.
    ///
    /// The options are not checked here; see [`FitOptions::validate`].
    ///
    /// # Errors
    /// If the file is missing, has a wrong entry, or its bounding sphere is not finite with a
    /// radius above 0.
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

    /// Writes the `fit.toml` of a run folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, run: &Path) -> anyhow::Result<()> {
        let text = toml::to_string(self)?;
        atomic_write(&run.join("fit.toml"), |out| Ok(out.write_all(text.as_bytes())?))
    }
}
