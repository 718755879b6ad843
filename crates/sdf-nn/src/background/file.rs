//! Background files: safetensors files with the tensors `sphere`, `tables` and `decoder`, and the
//! extent in the metadata.

use field::{Real, Sphere};
use glam::DVec3;
use safetensors::tensor::{Dtype, SafeTensors};

use crate::background::decoder::LENGTH;
use crate::background::grid::table_length;
use crate::background::volume::{Extent, Volume};
use crate::tensor_file::{Tensor, TensorFile, bytes, single};

/// An error of reading or writing a background file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FileError {
    /// The data is not valid in the safetensors format.
    #[error("invalid safetensors data: {0}")]
    Container(String),
    /// The metadata entry of the extent is missing or has a wrong value.
    #[error("metadata entry \"{EXTENT}\" is {found:?}, expected volume or direction")]
    Extent {
        /// The value in the file; empty if the entry is missing.
        found: String,
    },
    /// A tensor is missing, has a wrong shape or type, or has elements that are not finite.
    #[error("tensor \"{name}\" is {found}, expected {expected} finite numbers, up to 1e15")]
    Tensor {
        /// The tensor's name.
        name: &'static str,
        /// A description of the tensor in the file.
        found: String,
        /// The number of elements of a valid tensor, and their type.
        expected: String,
    },
}

/// The metadata entry of the extent.
const EXTENT: &str = "dsdf.background";

/// The largest size of a number: products of two are finite.
const MAX_MAGNITUDE: f32 = 1e15;

fn container(error: safetensors::SafeTensorError) -> FileError {
    FileError::Container(error.to_string())
}

/// The little-endian bytes of a tensor of this type and length.
fn bytes_of<'a>(
    tensors: &SafeTensors<'a>,
    name: &'static str,
    dtype: Dtype,
    length: usize,
) -> Result<&'a [u8], FileError> {
    let wrong = |found: String| {
        let expected = format!("{length} {dtype:?}");
        FileError::Tensor { name, found, expected }
    };
    let tensor = tensors.tensor(name).map_err(|_| wrong("missing".to_owned()))?;
    if tensor.dtype() != dtype || tensor.shape() != [length] {
        return Err(wrong(format!("{:?} of shape {:?}", tensor.dtype(), tensor.shape())));
    }
    Ok(tensor.data())
}

impl<R: Real> Volume<R> {
    /// The bytes of a background file, in single precision. Equal volumes give equal bytes.
    ///
    /// # Errors
    /// If the file format cannot hold them.
    pub fn to_safetensors(&self) -> Result<Vec<u8>, FileError> {
        Ok(self.file_about(DVec3::ZERO)?.to_bytes())
    }

    /// The background file of the same volume for points relative to `origin`, a point in world
    /// units.
    ///
    /// # Errors
    /// If the file format cannot hold it.
    pub fn file_about(&self, origin: DVec3) -> Result<TensorFile<'_>, FileError> {
        let [x, y, z] = (self.sphere.center - origin).to_array();
        let sphere: Vec<u8> =
            [x, y, z, self.sphere.radius].into_iter().flat_map(f64::to_le_bytes).collect();
        let (tables, decoder) = self.parameters.split_at(table_length());
        let tensors = vec![
            Tensor::vector("sphere", Dtype::F64, 4, bytes(sphere)),
            Tensor::vector("tables", Dtype::F32, table_length(), single(tables)),
            Tensor::vector("decoder", Dtype::F32, LENGTH, single(decoder)),
        ];
        let metadata = [(EXTENT.to_owned(), self.extent.to_string())].into();
        TensorFile::new(tensors, metadata).map_err(container)
    }

    /// Reads a volume from the bytes of a background file.
    ///
    /// # Errors
    /// If `bytes` is no safetensors file, or its metadata and tensors do not describe a volume.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, FileError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(container)?;
        let found = metadata.metadata().as_ref().and_then(|entries| entries.get(EXTENT));
        let extent = match found.map(String::as_str) {
            Some("volume") => Extent::Volume,
            Some("direction") => Extent::Direction,
            other => return Err(FileError::Extent { found: other.unwrap_or_default().to_owned() }),
        };
        let tensors = SafeTensors::deserialize(bytes).map_err(container)?;
        let own = bytes_of(&tensors, "sphere", Dtype::F64, 4)?;
        let own: Vec<f64> = own.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        let sphere = Sphere { center: DVec3::new(own[0], own[1], own[2]), radius: own[3] };
        if !(sphere.center.is_finite() && sphere.radius > 0.0 && sphere.radius.is_finite()) {
            let expected = "a centre and a radius above 0, as 4".to_owned();
            return Err(FileError::Tensor { name: "sphere", found: format!("{own:?}"), expected });
        }
        let mut parameters = Vec::new();
        for (name, length) in [("tables", table_length()), ("decoder", LENGTH)] {
            let own = bytes_of(&tensors, name, Dtype::F32, length)?;
            for (i, number) in own.chunks_exact(4).enumerate() {
                let number: f32 = bytemuck::pod_read_unaligned(number);
                if number.is_nan() || number.abs() > MAX_MAGNITUDE {
                    let (found, expected) = (format!("{number:e} at {i}"), format!("{length} F32"));
                    return Err(FileError::Tensor { name, found, expected });
                }
                parameters.push(R::of(f64::from(number)));
            }
        }
        Ok(Volume { extent, sphere, parameters })
    }
}
