//! The `.npy` files of `dsdf`.

use std::path::Path;

use crate::error::Error;
use crate::measure::image::Image;

/// Bytes of magic string, version and header length in a file of version 1.
const PREFIX: usize = 10;

/// Reads a float32 file of shape H × W × 3, little-endian and in C order, as `dsdf` writes it.
///
/// # Errors
/// If the file cannot be read, or is cut short.
pub fn read_image(path: &Path) -> Result<Image, Error> {
    let bytes = std::fs::read(path).map_err(Error::file(path))?;
    if bytes.len() <= PREFIX {
        return Err(Error::content(format!("{} is cut short", path.display())));
    }
    let start = PREFIX + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[PREFIX..start]).into_owned();
    let shape = header.split('(').nth(1).and_then(|s| s.split(')').next());
    let shape = shape.ok_or_else(Error::lacks("a shape"))?;
    let sizes: Vec<usize> = shape.split(',').filter_map(|s| s.trim().parse().ok()).collect();
    let numbers: Vec<f64> = bytes[start..]
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let width = *sizes.get(1).ok_or_else(Error::lacks("a width"))?;
    Ok(Image { width, pixels: numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect() })
}
