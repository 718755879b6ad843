//! The models of a data set: COLMAP writes one for each group of photographs that it connects.

use std::path::{Path, PathBuf};

use super::model::Model;
use super::records::ImageRecord;
use crate::readers::result::Result;

/// The model that is read.
pub(super) struct Candidates {
    pub(super) folder: PathBuf,
    pub(super) images: Vec<ImageRecord>,
    /// The sizes of all models, if there are several.
    pub(super) note: Option<String>,
}

/// The folders of the models of a data set: `sparse/0`, `sparse/1`, … or `sparse`; or the same in
/// `colmap/`, where nerfstudio has them; or `0`, `1`, … in `folder`, or `folder` itself. `None` if
/// none has a camera file.
pub(crate) fn models(folder: &Path) -> Option<Vec<PathBuf>> {
    let places = [folder.join("sparse"), folder.join("colmap/sparse"), folder.to_owned()];
    places.iter().find_map(|place| {
        let numbered = numbered(place);
        let all = if numbered.is_empty() { vec![place.clone()] } else { numbered };
        is_model(&all[0]).then_some(all)
    })
}

fn is_model(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file())
}

/// The models in the subfolders of `place` whose names are numbers, in their order.
fn numbered(place: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(place).into_iter().flatten().flatten();
    let number = |path: PathBuf| {
        let number: u32 = path.file_name()?.to_str()?.parse().ok()?;
        is_model(&path).then_some((number, path))
    };
    let mut models: Vec<_> = entries.filter_map(|entry| number(entry.path())).collect();
    models.sort();
    models.into_iter().map(|(_, path)| path).collect()
}

/// Reads the images of all models, and keeps those of the model with the most images, the first of
/// several. A model without a file of images has none.
///
/// # Errors
/// If a file of images is damaged, or missing from the only model.
pub(super) fn largest(data_set: &Path, candidates: &[PathBuf]) -> Result<Candidates> {
    let mut sizes = Vec::new();
    let mut best: Option<(PathBuf, Vec<ImageRecord>)> = None;
    for folder in candidates {
        let model = Model::in_folder(folder);
        let is_whole = candidates.len() == 1 || model.images.is_file();
        let images = if is_whole { model.images()? } else { Vec::new() };
        sizes.push((folder, images.len()));
        if best.as_ref().is_none_or(|(_, most)| images.len() > most.len()) {
            best = Some((folder.clone(), images));
        }
    }
    let (folder, images) = best.unwrap_or_default();
    let name =
        |folder: &Path| folder.strip_prefix(data_set).unwrap_or(folder).display().to_string();
    let others = sizes.iter().filter(|(other, _)| **other != folder);
    let others: Vec<String> =
        others.map(|(other, count)| format!("{} has {count}", name(other))).collect();
    let note = format!(
        "{} with {} images is read; {} (COLMAP could not connect all photographs)",
        name(&folder),
        images.len(),
        others.join(", ")
    );
    Ok(Candidates { folder, images, note: (!others.is_empty()).then_some(note) })
}
