//! NumPy arrays of floats.

use std::io::BufReader;
use std::path::Path;

use npyz::{DType, NpyFile, Order, TypeChar, WriterBuilder};

use super::atomic_write;
use crate::error::InputError;

/// Reads a float32 or float64 array, row-major: its shape and its numbers.
///
/// # Errors
/// If the file is missing, truncated or no such array.
pub fn read_npy(path: &Path) -> Result<(Vec<usize>, Vec<f32>), InputError> {
    let error = |found: String| InputError::new(path, "array", found, "a .npy file of float32 or float64");
    let file = std::fs::File::open(path).map_err(|e| error(e.to_string()))?;
    let npy = NpyFile::new(BufReader::new(file)).map_err(|e| error(e.to_string()))?;
    if npy.order() != Order::C {
        return Err(error("Fortran order".to_owned()));
    }
    let shape: Vec<usize> = npy.shape().iter().map(|n| *n as usize).collect();
    let plain = match npy.dtype() {
        DType::Plain(t) if t.type_char() == TypeChar::Float => t.size_field(),
        other => return Err(error(other.descr())),
    };
    let numbers: std::io::Result<Vec<f32>> = match plain {
        4 => npy.into_vec::<f32>(),
        8 => npy.into_vec::<f64>().map(|v| v.into_iter().map(|v| v as f32).collect()),
        other => return Err(error(format!("float{}", 8 * other))),
    };
    Ok((shape, numbers.map_err(|e| error(e.to_string()))?))
}

/// Writes a float32 array, row-major.
///
/// # Errors
/// If it cannot be written.
pub fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> anyhow::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
    atomic_write(path, |out| {
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
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
}
