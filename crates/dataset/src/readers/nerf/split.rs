//! nerfstudio's lists of the frames of each split.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value;

use super::views::{frames, read_frames};
use crate::readers::recognised::Recognised;
use crate::readers::result::Result;
use files::InputError;
use files::json::shown;

/// The names of the images of each split, without a leading `./`.
pub(super) struct Lists {
    train: Option<BTreeSet<String>>,
    /// Those of `test_filenames`, or else of `val_filenames`.
    test: BTreeSet<String>,
    /// All names with the places that have them.
    places: BTreeMap<String, String>,
}

/// Reads `train_filenames`, `test_filenames` and `val_filenames`; `None` if the file has none.
pub(super) fn lists(file: &Path, root: &Value) -> Result<Option<Lists>> {
    let mut places = BTreeMap::new();
    let mut list = |key: &str| -> Result<Option<BTreeSet<String>>> {
        let value = &root[key];
        if value.is_null() {
            return Ok(None);
        }
        let error = || InputError::new(file, key, shown(value), "an array of file names");
        let names = value.as_array().ok_or_else(error)?;
        let mut set = BTreeSet::new();
        for (i, name) in names.iter().enumerate() {
            let name = plain(name.as_str().ok_or_else(error)?);
            places.insert(name.to_owned(), format!("{key}/{i}"));
            set.insert(name.to_owned());
        }
        Ok(Some(set))
    };
    let (train, test) = (list("train_filenames")?, list("test_filenames")?);
    let validation = list("val_filenames")?;
    if train.is_none() && test.is_none() && validation.is_none() {
        return Ok(None);
    }
    let test = test.filter(|names| !names.is_empty()).or(validation).unwrap_or_default();
    Ok(Some(Lists { train, test, places }))
}

/// A name without a leading `./`.
fn plain(name: &str) -> &str {
    name.trim_start_matches("./")
}

impl Lists {
    /// The frames of the two splits. Without `train_filenames`, all frames that are not in another
    /// list are fitted.
    ///
    /// # Errors
    /// Those of the frames, and if a list has a name that no frame has.
    pub(super) fn read(
        mut self,
        folder: &Path,
        file: &Path,
        root: &Value,
        format: &str,
    ) -> Result<Recognised> {
        let (mut train, mut test, mut unused) = (Vec::new(), Vec::new(), 0);
        let others: BTreeSet<String> = self.places.keys().cloned().collect();
        for (i, frame) in frames(file, root)? {
            let name = plain(frame["file_path"].as_str().unwrap_or_default());
            self.places.remove(name);
            let is_fitted = match &self.train {
                Some(train) => train.contains(name),
                None => !others.contains(name),
            };
            if is_fitted {
                train.push((i, frame));
            } else if self.test.contains(name) {
                test.push((i, frame));
            } else {
                unused += 1;
            }
        }
        if let Some((name, place)) = self.places.first_key_value() {
            let expected = "the file_path of a frame";
            return Err(InputError::new(file, place, format!("{name:?}"), expected));
        }
        let train = read_frames(folder, file, train, root)?;
        let test = read_frames(folder, file, test, root)?;
        let mut recognised = Recognised::with_split(format, train, test);
        if unused > 0 {
            let text = "frames are neither in the list to fit nor in the one held out";
            recognised.notes.push(format!("{unused} {text}"));
        }
        Ok(recognised)
    }
}
