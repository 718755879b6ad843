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
    /// If the file is missing, has a wrong entry or lacks one, or if a number of the bounding
    /// sphere or of the background is out of range.
    pub fn load(run: &Path) -> Result<Self, InputError> {
        let path = run.join("fit.toml");
        let text = std::fs::read_to_string(&path)
            .map_err(|e| InputError::new(&path, "run", e, "the folder of a fit"))?;
        let file: RunFile = toml::from_str(&text).map_err(|e| {
            InputError::new(&path, key_at(&text, e.span()), e.message(), "the options of a fit")
        })?;
        file.refuse_missing(&path, &text)?;
        file.refuse_out_of_range(&path)?;
        Ok(file)
    }

    /// Refuses a file without one of the entries that [`RunFile::save`] writes: a default in its
    /// place would change the run.
    fn refuse_missing(&self, path: &Path, text: &str) -> Result<(), InputError> {
        let (Ok(complete), Ok(given)) = (toml::Table::try_from(self), text.parse()) else {
            return Ok(());
        };
        match missing_key(&complete, &given) {
            Some((key, value)) => {
                let expected = format!("an entry, by default {value}");
                Err(InputError::new(path, key, "nothing", expected))
            }
            None => Ok(()),
        }
    }

    fn refuse_out_of_range(&self, path: &Path) -> Result<(), InputError> {
        let Background { color, spread, confidence } = self.background();
        let sphere = self.sphere();
        let positive =
            sphere.center.is_finite() && sphere.radius.is_finite() && sphere.radius > 0.0;
        let checks = [
            ("bounds", format!("{:?}", self.bounds), positive, "x, y, z and a radius above 0"),
            (
                "background",
                format!("{color:?}"),
                color.iter().all(|c| c.is_finite() && *c >= 0.0),
                "three numbers, 0 or more",
            ),
            (
                "background_spread",
                spread.to_string(),
                spread.is_finite() && spread >= 0.0,
                "0 or more",
            ),
            (
                "background_confidence",
                confidence.to_string(),
                (0.0..=1.0).contains(&confidence),
                "0 to 1",
            ),
        ];
        match checks.into_iter().find(|(_, _, holds, _)| !holds) {
            Some((field, found, _, expected)) => Err(InputError::new(path, field, found, expected)),
            None => Ok(()),
        }
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

/// The key on the line that a TOML error is about; the name of the file if there is none.
fn key_at(text: &str, span: Option<std::ops::Range<usize>>) -> String {
    let line = span.filter(|span| text.get(span.clone()).is_some_and(|s| !s.contains('\n')));
    let line = line.and_then(|span| {
        let start = text.get(..span.start)?.rfind('\n').map_or(0, |end| end + 1);
        text.get(start..)?.lines().next()
    });
    let key = line.and_then(|line| line.split_once('=')).map(|(key, _)| key.trim().to_owned());
    key.unwrap_or_else(|| "fit.toml".to_owned())
}

/// The first entry of `complete` that `given` lacks, also in tables inside, with its value.
fn missing_key<'a>(
    complete: &'a toml::Table,
    given: &toml::Table,
) -> Option<(&'a String, &'a toml::Value)> {
    complete.iter().find_map(|(key, value)| match (value, given.get(key)) {
        (toml::Value::Table(complete), Some(toml::Value::Table(given))) => {
            missing_key(complete, given)
        }
        (_, Some(_)) => None,
        (value, None) => Some((key, value)),
    })
}
