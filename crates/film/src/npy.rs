//! NumPy arrays of floats (.npy files).

#![warn(clippy::cast_possible_truncation)]

use std::fmt::Display;
use std::fs::File;
use std::io::{BufReader, BufWriter, Chain, Cursor, Error, ErrorKind, Read, Write};
use std::path::Path;

use files::{InputError, WriteError, atomic_write, check_memory, open};
use half::f16;
use npyz::{DType, NpyFile, Order, TypeChar, WriterBuilder};

/// Bytes of memory for each byte of a .npy file: the numbers in both precisions, and the data that
/// are made of them.
const MEMORY_PER_BYTE: u64 = 8;

/// The longest header of a .npy file, in bytes: that of NumPy (`max_header_size`).
const LONGEST_HEADER: usize = 10_000;

/// The most brackets around each other in a header: those of the dictionary and of the shape, and
/// two more. The time of the parser of `npyz` doubles with each.
const DEEPEST_HEADER: usize = 4;

/// The length of the fixed start of a .npy file (magic string, version, length of the header), in
/// bytes. A shorter file is reported as no array instead of as a cut one.
const FIXED_START_BYTES: usize = 10;

/// Reads a .npy file of float16, float32 or float64, in either order of bytes.
///
/// Returns the shape and the numbers in C order (the last index varies fastest), also if the file
/// has them in Fortran order; their count is the product of the shape. Numbers of 64 bits are
/// rounded to 32.
///
/// # Errors
/// If the file is missing, is cut short or holds another kind of array.
pub fn read_npy(path: &Path) -> Result<(Vec<usize>, Vec<f32>), InputError> {
    let (npy, file_bytes) = open_npy(path)?;
    let order = npy.order();
    let number_bytes = match npy.dtype() {
        DType::Plain(t) if t.type_char() == TypeChar::Float => t.size_field(),
        other => return Err(array_error(path, other.descr())),
    };
    // A damaged header may give a shape that does not fit into memory. So the shape is checked
    // against the length of the file before memory is allocated.
    let shape = npy.shape().to_vec();
    let expected = shape.iter().try_fold(number_bytes, |bytes, n| bytes.checked_mul(*n));
    if expected.is_none_or(|bytes| bytes > file_bytes) {
        let found = format!("a file that is cut short: {file_bytes} bytes for the shape {shape:?}");
        return Err(array_error(path, found));
    }
    let shape = shape.into_iter().map(usize::try_from).collect::<Result<Vec<usize>, _>>();
    let shape = shape.map_err(|e| array_error(path, e))?;
    let numbers = match number_bytes {
        2 => npy.into_vec::<f16>().map(|v| v.into_iter().map(f32::from).collect()),
        4 => npy.into_vec::<f32>(),
        8 => npy.into_vec::<f64>().map(|v| v.into_iter().map(rounded).collect()),
        other => return Err(array_error(path, format!("float{}", 8 * other))),
    };
    let numbers = numbers.map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => array_error(path, "a file that is cut short"),
        _ => array_error(path, e),
    })?;
    let numbers = if order == Order::C { numbers } else { in_c_order(&shape, &numbers) };
    Ok((shape, numbers))
}

/// The numbers of an array of float16, float32 or float64, in C order: those of [`read_npy`] for a
/// small array from any reader.
///
/// # Errors
/// If the array has another type or is cut short.
pub fn npy_numbers<R: Read>(npy: NpyReader<R>) -> std::io::Result<Vec<f64>> {
    let shape = npy.shape().iter().map(|n| usize::try_from(*n)).collect::<Result<Vec<usize>, _>>();
    let shape = shape.map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
    let order = npy.order();
    let descr = npy.dtype().descr();
    let numbers: Vec<f64> = if descr.contains("f8") {
        npy.into_vec()?
    } else if descr.contains("f2") {
        npy.into_vec::<f16>()?.into_iter().map(f64::from).collect()
    } else {
        npy.into_vec::<f32>()?.into_iter().map(f64::from).collect()
    };
    Ok(if order == Order::C { numbers } else { in_c_order(&shape, &numbers) })
}

/// The numbers of an array of this shape in C order, from those in Fortran order (the first index
/// varies fastest).
fn in_c_order<T: Copy>(shape: &[usize], numbers: &[T]) -> Vec<T> {
    let steps: Vec<usize> = shape
        .iter()
        .scan(1usize, |step, n| Some(std::mem::replace(step, step.saturating_mul(*n))))
        .collect();
    let mut indices = vec![0; shape.len()];
    let mut at = 0;
    let mut next = |_| {
        let number = numbers[at];
        for axis in (0..shape.len()).rev() {
            indices[axis] += 1;
            at += steps[axis];
            if indices[axis] < shape[axis] {
                break;
            }
            at -= steps[axis] * shape[axis];
            indices[axis] = 0;
        }
        number
    };
    (0..numbers.len()).map(&mut next).collect()
}

/// A number rounded to single precision.
#[expect(clippy::cast_possible_truncation, reason = "it rounds, and large numbers become infinite")]
fn rounded(number: f64) -> f32 {
    number as f32
}

/// Opens a .npy file and reads its header; also returns the length of the file in bytes.
fn open_npy(path: &Path) -> Result<(NpyReader<BufReader<File>>, u64), InputError> {
    let (file, file_bytes) = open(path, "array", ARRAY)?;
    let memory = file_bytes.saturating_mul(MEMORY_PER_BYTE);
    check_memory(path, "array", format!("a file of {file_bytes} bytes"), memory)?;
    let npy = npy_reader(BufReader::new(file)).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof if file_bytes >= FIXED_START_BYTES as u64 => {
            array_error(path, "a file that is cut short")
        }
        _ => array_error(path, format!("no array ({e})")),
    })?;
    Ok((npy, file_bytes))
}

/// A reader of an array, behind its header.
pub type NpyReader<R> = NpyFile<Chain<Cursor<Vec<u8>>, R>>;

/// Reads the header of an array in the .npy format. The numbers are not read yet.
///
/// # Errors
/// If there is no header, or if it is longer or more deeply nested than that of an array of
/// numbers; its parser could take all memory or time.
pub fn npy_reader<R: Read>(mut reader: R) -> std::io::Result<NpyReader<R>> {
    let header = read_header(&mut reader)?;
    NpyFile::new(Cursor::new(header).chain(reader))
}

/// The bytes of an array's header, checked.
fn read_header(reader: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let invalid = |text: String| Error::new(ErrorKind::InvalidData, text);
    let mut header = vec![0; FIXED_START_BYTES];
    reader.read_exact(&mut header)?;
    let mut length = usize::from(u16::from_le_bytes([header[8], header[9]]));
    // From version 2, the length has four bytes.
    if header[6] > 1 {
        let mut upper = [0; 2];
        reader.read_exact(&mut upper)?;
        length += usize::from(u16::from_le_bytes(upper)) << 16;
        header.extend(upper);
    }
    if length > LONGEST_HEADER {
        return Err(invalid(format!("a header of {length} bytes")));
    }
    let start = header.len();
    header.resize(start + length, 0);
    reader.read_exact(&mut header[start..])?;
    let depth = nesting(&header[start..]);
    if depth > DEEPEST_HEADER {
        return Err(invalid(format!("a header with {depth} nested brackets")));
    }
    if overflows(&header[start..]) {
        return Err(invalid("a shape of more than 2^64 numbers".to_owned()));
    }
    Ok(header)
}

/// Whether the product of the numbers behind the word `shape` exceeds 64 bits: the parser
/// multiplies them without a check. A zero among them does not help, since it may be the last
/// factor.
fn overflows(header: &[u8]) -> bool {
    let at = header.windows(5).position(|word| word == b"shape").unwrap_or(header.len());
    let words = header[at..].split(|b| !(b.is_ascii_alphanumeric() || *b == b'_'));
    let numbers = words.filter(|word| word.first().is_some_and(u8::is_ascii_digit));
    let product = numbers
        .map(|word| std::str::from_utf8(word).ok()?.parse::<u64>().ok())
        .try_fold(1u64, |product, number| product.checked_mul(number?.max(1)));
    product.is_none()
}

/// The largest number of open brackets in a text.
fn nesting(text: &[u8]) -> usize {
    let (mut depth, mut deepest) = (0usize, 0);
    for byte in text {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        deepest = deepest.max(depth);
    }
    deepest
}

/// The files that can be read, for messages.
const ARRAY: &str = "a .npy file of float16, float32 or float64";

fn array_error(path: &Path, found: impl Display) -> InputError {
    InputError::new(path, "array", found, ARRAY)
}

/// Writes a .npy file of float32 in C order (the last index varies fastest), and replaces a file at
/// `path` whole.
///
/// # Errors
/// [`WriteError::Input`] if the folder does not accept files. [`WriteError::File`] if the count of
/// numbers is not the product of `shape`, or the file cannot be written.
pub fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> Result<(), WriteError> {
    let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
    atomic_write(path, |out| {
        // `npyz` writes number by number, and every call of a `dyn Write` has a cost.
        let mut out = BufWriter::new(out);
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut out).begin_nd()?;
        writer.extend(data.iter().copied())?;
        writer.finish()?;
        out.flush()
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

    #[test]
    fn any_order_of_numbers_and_bytes_and_half_precision_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        // The number at (i, j, k) is 100 i + 10 j + k, which half precision represents.
        let shape = [2, 3, 4];
        let number = |[i, j, k]: [u8; 3]| 100.0 * f32::from(i) + 10.0 * f32::from(j) + f32::from(k);
        let c_order = || (0..24u8).map(|n| [n / 12, n / 4 % 3, n % 4]);
        let fortran_order = || (0..24u8).map(|n| [n % 2, n / 2 % 3, n / 6]);
        let expected: Vec<f32> = c_order().map(number).collect();
        for fortran in [false, true] {
            let numbers: Vec<f32> = match fortran {
                true => fortran_order().map(number).collect(),
                false => expected.clone(),
            };
            let data = |bytes: &dyn Fn(f32) -> Vec<u8>| -> Vec<u8> {
                numbers.iter().flat_map(|v| bytes(*v)).collect()
            };
            for (kind, bytes) in [
                ("<f2", data(&|v| f16::from_f32(v).to_le_bytes().to_vec())),
                (">f2", data(&|v| f16::from_f32(v).to_be_bytes().to_vec())),
                ("<f4", data(&|v| v.to_le_bytes().to_vec())),
                (">f4", data(&|v| v.to_be_bytes().to_vec())),
                ("<f8", data(&|v| f64::from(v).to_le_bytes().to_vec())),
                (">f8", data(&|v| f64::from(v).to_be_bytes().to_vec())),
            ] {
                let order = if fortran { "True" } else { "False" };
                let header =
                    format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': (2, 3, 4)}}");
                let length = u16::try_from(header.len()).unwrap().to_le_bytes();
                let start = [b"\x93NUMPY\x01\0", &length[..], header.as_bytes()].concat();
                std::fs::write(&path, [&start[..], &bytes].concat()).unwrap();
                assert_eq!(read_npy(&path).unwrap(), (shape.to_vec(), expected.clone()), "{kind}");
                let npy = npy_reader(File::open(&path).unwrap()).unwrap();
                let of_reader = npy_numbers(npy).unwrap();
                assert!(
                    of_reader.iter().copied().eq(expected.iter().map(|v| f64::from(*v))),
                    "{kind}"
                );
                std::fs::write(&path, [&start[..], &bytes[1..]].concat()).unwrap();
                assert!(read_npy(&path).unwrap_err().to_string().contains("cut short"));
            }
        }
        assert!(in_c_order::<f32>(&[0, 3], &[]).is_empty());
        assert_eq!(in_c_order(&[], &[7.0]), [7.0]);
    }

    #[test]
    fn headers_that_a_parser_could_not_bear_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let array = |version: u8, length: &[u8], header: &str| {
            let start = [b"\x93NUMPY".as_slice(), &[version, 0], length].concat();
            std::fs::write(&path, [&start, header.as_bytes()].concat()).unwrap();
            let start = std::time::Instant::now();
            let message = read_npy(&path).unwrap_err().to_string();
            assert!(start.elapsed().as_secs() < 1, "{message}");
            message
        };
        let shaped = |shape: &str| {
            let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}");
            array(1, &u16::try_from(header.len()).unwrap().to_le_bytes(), &header)
        };
        let nested =
            |open: &str, close: &str| shaped(&format!("{}2{}", open.repeat(22), close.repeat(22)));
        assert!(nested("[", "]").contains("23 nested brackets"));
        assert!(nested("(", ",)").contains("23 nested brackets"));
        for huge in ["2, ".repeat(64), "4294967296, 4294967296, 0".into(), "0xf, 1".into()] {
            let message = shaped(&format!("({huge})"));
            assert!(message.contains("more than 2^64 numbers"), "{message}");
        }
        assert!(array(2, &[0xff; 4], "{}").contains("a header of 4294967295 bytes"));
        assert!(array(1, &[0xff; 2], "{}").contains("a header of 65535 bytes"));
        assert!(array(1, &[2, 0], "{").contains("cut short"));
    }

    fn array_bytes<T: npyz::AutoSerialize + Copy>(data: &[T]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let options = npyz::WriteOptions::new().default_dtype().shape(&[data.len() as u64]);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(data.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes.into_inner()
    }
}
