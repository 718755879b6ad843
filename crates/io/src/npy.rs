//! NumPy arrays of floats (.npy files).

use std::fmt::Display;
use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Write};
use std::path::Path;

use npyz::{DType, NpyFile, Order, TypeChar, WriterBuilder};

use crate::{InputError, atomic_write};

/// The length of the fixed start of a .npy file (magic string, version, length of the header), in
/// bytes. A shorter file is reported as no array instead of as a cut one.
const FIXED_START_BYTES: u64 = 10;

/// Reads a .npy file of float32 or float64 in C order (the last index varies fastest).
///
/// Returns the shape and the numbers; their count is the product of the shape. Numbers of 64 bits
/// are rounded to 32.
///
/// # Errors
/// If the file is missing, is cut short or holds another kind of array.
pub fn read_npy(path: &Path) -> Result<(Vec<usize>, Vec<f32>), InputError> {
    let (npy, file_bytes) = open_npy(path)?;
    if npy.order() != Order::C {
        return Err(array_error(path, "Fortran order"));
    }
    let shape: Vec<usize> = npy.shape().iter().map(|n| *n as usize).collect();
    let number_bytes = match npy.dtype() {
        DType::Plain(t) if t.type_char() == TypeChar::Float => t.size_field(),
        other => return Err(array_error(path, other.descr())),
    };
    // A damaged header may give a shape that does not fit into memory. So the shape is checked
    // against the length of the file before memory is allocated.
    let expected = npy.shape().iter().try_fold(number_bytes, |bytes, n| bytes.checked_mul(*n));
    if expected.is_none_or(|bytes| bytes > file_bytes) {
        let found = format!("a file that is cut short: {file_bytes} bytes for the shape {shape:?}");
        return Err(array_error(path, found));
    }
    let numbers = match number_bytes {
        4 => npy.into_vec::<f32>(),
        8 => npy.into_vec::<f64>().map(|v| v.into_iter().map(|v| v as f32).collect()),
        other => return Err(array_error(path, format!("float{}", 8 * other))),
    };
    let numbers = numbers.map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => array_error(path, "a file that is cut short"),
        _ => array_error(path, e),
    })?;
    Ok((shape, numbers))
}

/// Opens a .npy file and reads its header; also returns the length of the file in bytes.
fn open_npy(path: &Path) -> Result<(NpyFile<BufReader<File>>, u64), InputError> {
    let file = File::open(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => array_error(path, "no such file"),
        _ => array_error(path, e),
    })?;
    let file_bytes = file.metadata().map_err(|e| array_error(path, e))?.len();
    let npy = NpyFile::new(BufReader::new(file)).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof if file_bytes >= FIXED_START_BYTES => {
            array_error(path, "a file that is cut short")
        }
        _ => array_error(path, format!("no array ({e})")),
    })?;
    Ok((npy, file_bytes))
}

fn array_error(path: &Path, found: impl Display) -> InputError {
    InputError::new(path, "array", found, "a .npy file of float32 or float64, row-major")
}

/// Writes a .npy file of float32 in C order (the last index varies fastest), and replaces a file at
/// `path` whole.
///
/// # Errors
/// If the count of numbers is not the product of `shape`, or the file cannot be written; an
/// [`InputError`] if the folder does not accept files.
pub fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> anyhow::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
    atomic_write(path, |out| {
        // `npyz` writes number by number, and every call of a `dyn Write` has a cost.
        let mut out = BufWriter::new(out);
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut out).begin_nd()?;
        writer.extend(data.iter().copied())?;
        writer.finish()?;
        Ok(out.flush()?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_and_cut_files_are_refused() {
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
    fn double_precision_is_read_and_other_types_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, array_bytes(&[1.5f64, -2.0])).unwrap();
        assert_eq!(read_npy(&path).unwrap(), (vec![2], vec![1.5, -2.0]));
        std::fs::write(&path, array_bytes(&[1i64, 2])).unwrap();
        assert!(read_npy(&path).unwrap_err().to_string().contains("float32"));
        // A shape that does not fit into memory, written over the padding of the header.
        let mut damaged = array_bytes(&[0.0f64; 2]);
        let start = damaged.windows(3).position(|w| w == b"(2,").unwrap();
        let rest = b"(1000000000, 1000000000)}";
        damaged[start..start + rest.len()].copy_from_slice(rest);
        std::fs::write(&path, damaged).unwrap();
        assert!(read_npy(&path).unwrap_err().to_string().contains("cut short"));
    }

    fn array_bytes<T: npyz::AutoSerialize + Copy>(data: &[T]) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let options = npyz::WriteOptions::new().default_dtype().shape(&[data.len() as u64]);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(data.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes.into_inner()
    }
}
