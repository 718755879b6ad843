//! The points of `.ply` files.

use std::path::Path;

use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use crate::readers::result::Result;
use files::InputError;

/// The coordinates of a vertex; NaN if missing.
struct Point([f64; 3]);

impl PropertyAccess for Point {
    fn new() -> Self {
        Point([f64::NAN; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(i) = ["x", "y", "z"].iter().position(|n| *n == name) else {
            return PropertyAccessResult::Ignored;
        };
        self.0[i] = match property {
            Property::Float(v) => f64::from(v),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Bytes of memory for each element while a file is read.
const MEMORY_PER_ELEMENT: u64 = 64;

/// The finite vertices of a `.ply` file, text or binary.
///
/// # Errors
/// If the file is missing or damaged, or has no element `vertex` with x, y and z.
pub(crate) fn points(path: &Path) -> Result<Vec<DVec3>> {
    let error = |found: String| InputError::new(path, "points", found, "a PLY file with vertices");
    let bytes = files::read(path, "points", "a .ply file")?;
    let parser = Parser::<Point>::new();
    let mut reader = Reader::new(bytes.as_slice());
    let header = parser.read_header(&mut reader).map_err(|e| error(e.to_string()))?;
    check_counts(path, &header, reader.get_ref().len())?;
    let mut payload =
        parser.read_payload(&mut reader, &header).map_err(|e| error(e.to_string()))?;
    let vertices = payload.swap_remove("vertex").ok_or_else(|| error("no vertices".to_owned()))?;
    let properties = header.elements.get("vertex").map(|vertex| &vertex.properties);
    for axis in ["x", "y", "z"] {
        if !properties.is_some_and(|properties| properties.contains_key(axis)) {
            return Err(error(format!("vertices without {axis}")));
        }
    }
    let points = vertices.iter().map(|p| DVec3::from(p.0));
    Ok(points.filter(|p| p.is_finite()).collect())
}

/// Checks the counts of a header against the `length` bytes that follow it: the parser believes
/// them.
fn check_counts(path: &Path, header: &Header, length: usize) -> Result<()> {
    let (mut least, mut count) = (0u64, 0u64);
    for element in header.elements.values() {
        let sizes = element.properties.values().map(|p| least_size(header, &p.data_type));
        let (size, elements) = (sizes.sum::<u64>(), element.count as u64);
        least = least.saturating_add(size.saturating_mul(elements));
        count = count.saturating_add(elements);
        // The last line of a text may lack its end.
        if least > length as u64 + 1 || (size == 0 && elements > 0) {
            let found = format!("{elements} elements of {} in {length} bytes", element.name);
            let expected = "a count that the file has room for, or the whole file";
            return Err(InputError::new(path, "points", found, expected));
        }
    }
    let memory = count.saturating_mul(MEMORY_PER_ELEMENT);
    files::check_memory(path, "points", format!("{count} elements"), memory)
}

/// The fewest bytes of a property: a digit and a blank in text, a list without entries in binary.
fn least_size(header: &Header, property: &PropertyType) -> u64 {
    let (PropertyType::Scalar(number) | PropertyType::List(number, _)) = property;
    match (header.encoding, number) {
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    }
}
