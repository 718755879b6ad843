//! The binary form of a sparse model: little endian, no padding.

use std::path::Path;

use glam::DVec3;

use super::records::{CameraRecord, ImageRecord, PointRecord};
use crate::readers::result::Result;
use files::InputError;

/// Name and parameter count of each camera model; the index is the model's number.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

/// The bytes of a file, read from front to back. `item` names the next item in error messages.
struct Bytes<'a> {
    file: &'a Path,
    data: Vec<u8>,
    at: usize,
}

impl<'a> Bytes<'a> {
    fn open(file: &'a Path) -> Result<Self> {
        let data = files::read(file, "file", "a readable file")?;
        Ok(Bytes { file, data, at: 0 })
    }

    /// The next `count` bytes.
    fn take(&mut self, count: usize, item: &str) -> Result<&[u8]> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.data.len());
        let end = end.ok_or_else(|| {
            let (place, expected) =
                (format!("byte {}", self.at), format!("{count} bytes of {item}"));
            let found = format!("the file's end at byte {}", self.data.len());
            InputError::new(self.file, place, found, expected)
        })?;
        let start = std::mem::replace(&mut self.at, end);
        Ok(&self.data[start..end])
    }

    fn array<const N: usize>(&mut self, item: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N, item)?);
        Ok(bytes)
    }

    fn u32(&mut self, item: &str) -> Result<u32> {
        self.array(item).map(u32::from_le_bytes)
    }

    fn u64(&mut self, item: &str) -> Result<u64> {
        self.array(item).map(u64::from_le_bytes)
    }

    fn f64(&mut self, item: &str) -> Result<f64> {
        self.array(item).map(f64::from_le_bytes)
    }

    fn vector(&mut self, item: &str) -> Result<DVec3> {
        Ok(DVec3::new(self.f64(item)?, self.f64(item)?, self.f64(item)?))
    }

    /// A string that ends in a zero byte.
    fn text(&mut self, item: &str) -> Result<String> {
        let length = self.data[self.at..].iter().position(|b| *b == 0).unwrap_or(self.data.len());
        let text = String::from_utf8_lossy(self.take(length, item)?).into_owned();
        self.take(1, item)?;
        Ok(text)
    }

    /// Skips a list: its length, then records of `size` bytes each. Returns the length.
    fn skip_list(&mut self, size: usize, item: &str) -> Result<usize> {
        let count = usize::try_from(self.u64(item)?).unwrap_or(usize::MAX);
        self.take(count.saturating_mul(size), item)?;
        Ok(count)
    }

    /// The error of the item just read.
    fn error(&self, field: &str, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.file, format!("{field} before byte {}", self.at), found, expected)
    }
}

/// Reads `cameras.bin`: id, model, width, height, parameters.
pub(super) fn cameras(file: &Path) -> Result<Vec<CameraRecord>> {
    let mut bytes = Bytes::open(file)?;
    let count = bytes.u64("the number of cameras")?;
    (0..count)
        .map(|_| {
            let id = bytes.u32("a camera's number")?;
            let model = bytes.u32("a camera model")?;
            let known = usize::try_from(model).ok().and_then(|m| MODELS.get(m));
            let (model, parameters) = *known
                .ok_or_else(|| bytes.error("camera model", model, "a number from 0 to 17"))?;
            let size = [bytes.u64("a camera's width")?, bytes.u64("a camera's height")?];
            let parameters: Result<Vec<f64>> =
                (0..parameters).map(|_| bytes.f64("a camera's parameters")).collect();
            Ok(CameraRecord { id, model: model.to_owned(), size, parameters: parameters? })
        })
        .collect()
}

/// Reads `images.bin`: id, quaternion, translation, camera id, name; image points are skipped.
pub(super) fn images(file: &Path) -> Result<Vec<ImageRecord>> {
    let mut bytes = Bytes::open(file)?;
    let count = bytes.u64("the number of images")?;
    (0..count)
        .map(|_| {
            bytes.u32("an image's number")?;
            let w = bytes.f64("a quaternion")?;
            let xyz = bytes.vector("a quaternion")?;
            let translation = bytes.vector("a translation")?;
            let camera = bytes.u32("a camera's number")?;
            let name = bytes.text("an image's name")?;
            bytes.skip_list(24, "image points")?;
            Ok(ImageRecord { quaternion: [w, xyz.x, xyz.y, xyz.z], translation, camera, name })
        })
        .collect()
}

/// Reads `points3D.bin`: id, position and error; colour is skipped, and of the track all but its
/// length.
pub(super) fn points(file: &Path) -> Result<Vec<PointRecord>> {
    let mut bytes = Bytes::open(file)?;
    let count = bytes.u64("the number of points")?;
    (0..count)
        .map(|_| {
            bytes.u64("a point's number")?;
            let position = bytes.vector("a point")?;
            bytes.take(3, "a point's colour")?;
            let error = Some(bytes.f64("a point's error")?);
            let views = bytes.skip_list(8, "a point's track")?;
            Ok(PointRecord { position, error, views })
        })
        .collect()
}
