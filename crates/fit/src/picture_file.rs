//! The file of a picture behind the object: a safetensors file with the tensors `picture` (height ×
//! width × 3, linear RGB) and `known` (height × width, 1 where photographs show it), and with
//! `dsdf.background` = `picture` and the spread in the metadata.

use std::path::Path;

use files::{InputError, atomic_write};
use film::Film;
use inspect::Picture;
use safetensors::{Dtype, SafeTensors};
use sdf_nn::tensor_file::{Tensor, TensorFile, bytes};

use crate::error::FitError;

/// The metadata entry of the kind, and that of the spread.
const KIND: &str = "dsdf.background";
const SPREAD: &str = "spread";

const EXPECTED: &str = "the picture of a run, as in fit.toml";

/// Writes the picture as a whole: an interrupted write leaves the old file.
pub(crate) fn save(picture: &Picture, path: &Path) -> Result<(), FitError> {
    let Film { width, height, pixels } = picture.image();
    let shape = vec![*height as usize, *width as usize];
    let colors: Vec<u8> = pixels.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let known: Vec<u8> = picture.is_known().iter().map(|known| u8::from(*known)).collect();
    let tensors = vec![
        Tensor {
            name: "picture".to_owned(),
            dtype: Dtype::F32,
            shape: [&shape[..], &[3]].concat(),
            elements: bytes(colors),
        },
        Tensor { name: "known".to_owned(), dtype: Dtype::U8, shape, elements: bytes(known) },
    ];
    let entry = |key: &str, value: String| (key.to_owned(), value);
    let metadata =
        [entry(KIND, "picture".to_owned()), entry(SPREAD, picture.spread.to_string())].into();
    let file = TensorFile::new(tensors, metadata)?;
    Ok(atomic_write(path, |out| file.write(out))?)
}

/// The picture of a file at `path` with this content.
///
/// # Errors
/// If it is no file of a picture, or a number is negative or not finite.
pub(crate) fn parse(content: &[u8], path: &Path) -> Result<Picture, InputError> {
    let wrong = |field: &str, found: String| InputError::new(path, field, found, EXPECTED);
    let container = |e: safetensors::SafeTensorError| wrong("background", e.to_string());
    let (_, header) = SafeTensors::read_metadata(content).map_err(container)?;
    let entry = |key: &str| header.metadata().as_ref()?.get(key).cloned();
    let kind = entry(KIND).unwrap_or_default();
    if kind != "picture" {
        return Err(wrong(KIND, format!("{kind:?}")));
    }
    let spread = entry(SPREAD).and_then(|spread| spread.parse::<f32>().ok());
    let spread = spread.filter(|spread| spread.is_finite() && *spread >= 0.0);
    let spread = spread.ok_or_else(|| wrong(SPREAD, "no number of 0 or more".to_owned()))?;

    let tensors = SafeTensors::deserialize(content).map_err(container)?;
    let tensor = |name: &str| tensors.tensor(name).map_err(|e| wrong(name, e.to_string()));
    let (colors, known) = (tensor("picture")?, tensor("known")?);
    let is_typed = colors.dtype() == Dtype::F32 && known.dtype() == Dtype::U8;
    let sides = match colors.shape() {
        [height, width, 3] if is_typed && known.shape() == [*height, *width] => [*width, *height],
        other => return Err(wrong("picture", format!("tensors of shape {other:?}"))),
    };
    let number = |bytes: &[u8]| bytes.try_into().map(f32::from_le_bytes).unwrap_or(f32::NAN);
    let pixel = |own: &[u8]| [0, 4, 8].map(|at| number(&own[at..at + 4]));
    let pixels: Vec<[f32; 3]> = colors.data().chunks_exact(12).map(pixel).collect();
    if let Some(found) = pixels.as_flattened().iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
        return Err(wrong("picture", found.to_string()));
    }
    let is_known = known.data().iter().map(|known| *known != 0).collect();
    let [width, height] = sides.map(|side| u32::try_from(side).unwrap_or(0));
    Picture::new(Film { width, height, pixels }, is_known, spread, Vec::new())
        .ok_or_else(|| wrong("picture", format!("{width} x {height} pixels")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_survives_its_file_and_a_wrong_file_is_refused() {
        let pixels = (0..6).map(|i| [0.1 * i as f32, 0.5, 0.25]).collect();
        let known = vec![true, false, true, true, true, true];
        let image = Film { width: 3, height: 2, pixels };
        let picture = Picture::new(image, known, 0.01, Vec::new()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("background.safetensors");
        save(&picture, &path).unwrap();
        let content = std::fs::read(&path).unwrap();
        assert_eq!(parse(&content, &path).unwrap(), picture);
        let mut harmed = content.clone();
        // The first number: flags of a byte follow 18 numbers.
        let at = harmed.len() - 6 - 18 * 4;
        harmed[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        for content in [&harmed[..], &content[..40], b""] {
            let error = parse(content, &path).unwrap_err().to_string();
            assert!(error.contains("background.safetensors"), "{error}");
            assert!(!error.contains('\n'), "{error}");
        }
    }
}
