//! NumPy arrays of floats.

use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::Path;

use npyz::{DType, NpyFile, Order, TypeChar, WriterBuilder};

use super::atomic_write;
use crate::InputError;

/// Reads a float32 or float64 array, row-major: its shape and its numbers.
///
/// # Errors
/// If the file is missing, truncated or no such array.
pub fn read_npy(path: &Path) -> Result<(Vec<usize>, Vec<f32>), InputError> {
    let error = |found: String| {
        InputError::new(path, "array", found, "a .npy file of float32 or float64, row-major")
    };
    let file = File::open(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => error("no such file".to_owned()),
        _ => error(e.to_string()),
    })?;
    let bytes = file.metadata().map_err(|e| error(e.to_string()))?.len();
    let npy = NpyFile::new(BufReader::new(file)).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof if bytes >= 10 => error("a file that is cut short".to_owned()),
        _ => error(format!("no array ({e})")),
    })?;
    if npy.order() != Order::C {
        return Err(error("Fortran order".to_owned()));
    }
    let shape: Vec<usize> = npy.shape().iter().map(|n| *n as usize).collect();
    let plain = match npy.dtype() {
        DType::Plain(t) if t.type_char() == TypeChar::Float => t.size_field(),
        other => return Err(error(other.descr())),
    };
    // A header may promise more than memory holds, so it is checked against the file before
    // anything is allocated.
    let promised = npy.shape().iter().try_fold(plain, |size, n| size.checked_mul(*n));
    if promised.is_none_or(|size| size > bytes) {
        return Err(error(format!(
            "a file that is cut short: {bytes} bytes for the shape {shape:?}"
        )));
    }
    let numbers: std::io::Result<Vec<f32>> = match plain {
        4 => npy.into_vec::<f32>(),
        8 => npy.into_vec::<f64>().map(|v| v.into_iter().map(|v| v as f32).collect()),
        other => return Err(error(format!("float{}", 8 * other))),
    };
    let numbers = numbers.map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => error("a file that is cut short".to_owned()),
        _ => error(e.to_string()),
    })?;
    Ok((shape, numbers))
}

/// Writes a float32 array, row-major.
///
/// # Errors
/// If it cannot be written.
pub fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> anyhow::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
    atomic_write(path, |out| {
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
        writer.extend(data.iter().copied())?;
        Ok(writer.finish()?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_and_truncated_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let data: Vec<f32> = (0..6).map(|i| i as f32 / 3.0).collect();
        write_npy(&path, &[2, 3], &data).unwrap();
        assert_eq!(read_npy(&path).unwrap(), (vec![2, 3], data));
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 5, 60, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(read_npy(&path).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn wide_floats_are_read_and_other_types_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, npyz_bytes(&[1.5f64, -2.0])).unwrap();
        assert_eq!(read_npy(&path).unwrap(), (vec![2], vec![1.5, -2.0]));
        std::fs::write(&path, npyz_bytes(&[1i64, 2])).unwrap();
        assert!(read_npy(&path).unwrap_err().to_string().contains("float32"));
        // A shape that no memory holds, in the room that headers are padded with.
        let mut poisoned = npyz_bytes(&[0.0f64; 2]);
        let start = poisoned.windows(3).position(|w| w == b"(2,").unwrap();
        let rest = b"(1000000000, 1000000000)}";
        poisoned[start..start + rest.len()].copy_from_slice(rest);
        std::fs::write(&path, poisoned).unwrap();
        assert!(read_npy(&path).unwrap_err().to_string().contains("cut short"));
    }

    fn npyz_bytes<T: npyz::AutoSerialize + Copy>(data: &[T]) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let options = npyz::WriteOptions::new().default_dtype().shape(&[data.len() as u64]);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(data.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes.into_inner()
    }
}
