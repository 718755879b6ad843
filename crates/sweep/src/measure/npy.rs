//! The `.npy` files of `dsdf`.

use std::path::Path;

use crate::error::Error;
use crate::measure::image::Image;

/// Bytes of magic string, version and header length in a file of version 1.
const PREFIX: usize = 10;

/// Reads a float32 file of shape H × W × 3, little-endian and in C order, as `dsdf` writes it; one of
/// shape H × W has the same number in all three channels.
///
/// # Errors
/// If the file cannot be read, is cut short, or has another shape.
pub fn read_image(path: &Path) -> Result<Image, Error> {
    let bytes = std::fs::read(path).map_err(Error::file(path))?;
    if bytes.len() <= PREFIX {
        return Err(Error::content(format!("{} is cut short", path.display())));
    }
    let start = PREFIX + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[PREFIX..start.min(bytes.len())]).into_owned();
    let shape = header.split('(').nth(1).and_then(|s| s.split(')').next());
    let shape = shape.ok_or_else(Error::lacks("a shape"))?;
    let sizes: Vec<usize> = shape.split(',').filter_map(|s| s.trim().parse().ok()).collect();
    let (width, channels) = match sizes[..] {
        [_, width] => (width, 1),
        [_, width, 3] => (width, 3),
        _ => {
            let found = format!("{}: the shape ({shape}), expected (H, W, 3)", path.display());
            return Err(Error::content(found));
        }
    };
    let numbers: Vec<f64> = bytes[start.min(bytes.len())..]
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let pixel = |own: &[f64]| std::array::from_fn(|c| own[c.min(channels - 1)]);
    Ok(Image { width, pixels: numbers.chunks_exact(channels).map(pixel).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with a header of this shape, and numbers from 1 on.
    fn read(shape: &str, count: u8) -> Result<Image, Error> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.npy");
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        (1..=count).for_each(|i| bytes.extend(f32::from(i).to_le_bytes()));
        std::fs::write(&path, bytes)?;
        read_image(&path)
    }

    #[test]
    fn images_of_one_and_of_three_channels_are_read() {
        let grey = read("2, 1", 2).unwrap();
        assert_eq!((grey.width, &grey.pixels[..]), (1, &[[1.0; 3], [2.0; 3]][..]));
        let color = read("1, 2, 3", 6).unwrap();
        assert_eq!(color.pixels, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        for shape in ["6", "1, 3, 2", "1, 1, 1, 3"] {
            assert!(read(shape, 6).is_err(), "{shape}");
        }
    }
}
