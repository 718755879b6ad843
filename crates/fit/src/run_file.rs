//! `fit.toml` of a run folder.

use std::path::{Path, PathBuf};

use dataset::Background;
use field::Sphere;
use glam::DVec3;
use io::{InputError, atomic_write};
use serde::{Deserialize, Serialize};

use crate::background::BackgroundModel;
use crate::options::FitOptions;

/// `fit.toml`: the input of a run, from which the run can be resumed and evaluated.
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
    /// The confidence in the background, 0 to 1.
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

    /// The evidence for background pixels.
    pub(crate) fn background_model(&self) -> BackgroundModel {
        BackgroundModel {
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
