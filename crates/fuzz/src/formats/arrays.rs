//! NumPy arrays, and zip archives of them.

use std::io::Write;

use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc, FlushCompress};
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::json;

use crate::case::Case;
use crate::layout::Layout;
use crate::spoil::{self, Spoil, sometimes_spoiled, spoiled};
use crate::tree::Tree;

/// A .npy file.
#[derive(Clone, Debug)]
pub(crate) struct Array {
    version: u8,
    /// A wrong length of the header in place of the right one.
    length: Option<u64>,
    header: Tree,
    data: Vec<u8>,
}

impl Array {
    /// An array of this type, for example `<f4`, with these bytes.
    fn new(descr: &str, fortran: bool, shape: &[usize], data: Vec<u8>) -> Self {
        let mut header = Tree::from(json!({"descr": descr, "fortran_order": 0, "shape": shape}));
        if let Some(order) = header.get_mut("fortran_order") {
            *order = Tree::Leaf(if fortran { b"True".to_vec() } else { b"False".to_vec() });
        }
        Array { version: 1, length: None, header, data }
    }

    /// A matrix of double precision with four rows.
    pub(crate) fn matrix(rows: [[f64; 4]; 4]) -> Self {
        let data = rows.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        Array::new("<f8", false, &[4, 4], data)
    }

    /// An array of double precision with rows of equal length.
    pub(crate) fn table(rows: &[Vec<f64>]) -> Self {
        let data = rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        Array::new("<f8", false, &[rows.len(), rows.first().map_or(0, Vec::len)], data)
    }

    /// The bytes before the data.
    fn start(&self) -> Vec<u8> {
        let mut header = self.header.python();
        let width = if self.version == 1 { 2 } else { 4 };
        let padded = (8 + width + header.len() + 1).next_multiple_of(64) - 8 - width;
        header.resize(padded - 1, b' ');
        header.push(b'\n');
        Layout::default()
            .bytes(*b"\x93NUMPY")
            .integer(self.version.into(), 1)
            .integer(0, 1)
            .integer(self.length.unwrap_or(padded as u64), width)
            .bytes(header)
            .to_bytes()
    }

    /// The bytes of the file.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        [self.start(), self.data.clone()].concat()
    }
}

impl Spoil for Array {
    fn spoil(&mut self, place: usize, harm: usize) {
        match place % 10 {
            0 => self.version = (harm % 5) as u8,
            1 => self.length = Some(spoil::integer(128, harm)),
            2 => self.data = spoil::bytes(&self.data, harm),
            _ => self.header.spoil(place / 10, harm),
        }
    }
}

/// Arrays of one to four dimensions, of all types of NumPy.
fn arrays() -> impl Strategy<Value = Array> + Clone {
    let types = prop_oneof![
        6 => prop::sample::select(vec![("<f4", 4), ("<f8", 8)]),
        1 => prop::sample::select(vec![(">f4", 4), ("<f2", 2), ("<i8", 8), ("|b1", 1)]),
    ];
    let shapes = prop_oneof![
        3 => (1..9usize).prop_map(|n| vec![n, 3]),
        2 => (1..9usize, 1..9usize).prop_map(|(h, w)| vec![h, w, 3]),
        2 => vec(0..6usize, 1..4),
    ];
    (types, shapes, prop::bool::weighted(0.1), any::<u8>()).prop_map(
        |(kind, shape, order, byte)| {
            let count: usize = shape.iter().product();
            // Small positive numbers, as bytes of equal value are.
            Array::new(kind.0, order, &shape, vec![byte % 64; count * kind.1])
        },
    )
}

/// A file `array.npy`.
pub(crate) fn array_files() -> BoxedStrategy<Case> {
    spoiled(arrays()).prop_map(|a| Case::default().file("array.npy", a.to_bytes())).boxed()
}

/// An array of numbers as an image: a .npy file.
pub(crate) fn array_images() -> BoxedStrategy<Vec<u8>> {
    spoiled(arrays()).prop_map(|a| a.to_bytes()).boxed()
}

/// A file of a zip archive.
#[derive(Clone, Debug)]
struct Member {
    name: String,
    /// 0: stored, 8: deflated.
    method: u64,
    /// The bytes in the archive.
    packed: Vec<u8>,
    crc: u64,
    size: u64,
}

/// A member of an archive with this content.
fn member(name: &str, content: &[u8], deflate: bool) -> Member {
    let mut crc = Crc::new();
    crc.update(content);
    let packed = if deflate { deflated(content, 0) } else { content.to_vec() };
    let (method, crc, size) = (if deflate { 8 } else { 0 }, crc.sum().into(), content.len() as u64);
    Member { name: name.to_owned(), method, packed, crc, size }
}

/// Deflates a text, followed by `mebibytes` of zeros, which take a thousandth of their length.
pub(crate) fn deflated(head: &[u8], mebibytes: usize) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
    let written = encoder.write_all(head).and_then(|()| encoder.flush());
    debug_assert!(written.is_ok(), "a vector takes every byte");
    let mut out = std::mem::take(encoder.get_mut());
    let mut zeros = Vec::with_capacity(1 << 14);
    let mut compress = flate2::Compress::new(Compression::best(), false);
    let packed = compress.compress_vec(&vec![0; 1 << 20], &mut zeros, FlushCompress::Full);
    debug_assert!(packed.is_ok(), "zeros can be packed");
    out.extend(zeros.repeat(mebibytes));
    // An empty last block.
    out.extend([0x03, 0x00]);
    out
}

/// The fields of an archive: members, then the directory, then its end.
fn archive(members: &[Member]) -> Layout {
    let (mut files, mut directory) = (Layout::default(), Layout::default());
    let mut offset = 0u64;
    for Member { name, method, packed, crc, size } in members {
        let common = |layout: Layout| {
            layout
                .integer(20, 2)
                .integer(0, 2)
                .integer(*method, 2)
                .integer(0, 4)
                .integer(*crc, 4)
                .integer(packed.len() as u64, 4)
                .integer(*size, 4)
                .integer(name.len() as u64, 2)
                .integer(0, 2)
        };
        files = common(files.bytes(*b"PK\x03\x04")).bytes(name.as_bytes()).bytes(packed.clone());
        directory = common(directory.bytes(*b"PK\x01\x02").integer(20, 2))
            .integer(0, 2)
            .integer(0, 2)
            .integer(0, 2)
            .integer(0, 4)
            .integer(offset, 4)
            .bytes(name.as_bytes());
        offset += 30 + name.len() as u64 + packed.len() as u64;
    }
    let (count, length) = (members.len() as u64, directory.to_bytes().len() as u64);
    files
        .append(directory)
        .bytes(*b"PK\x05\x06")
        .integer(0, 2)
        .integer(0, 2)
        .integer(count, 2)
        .integer(count, 2)
        .integer(length, 4)
        .integer(offset, 4)
        .integer(0, 2)
}

/// An array that inflates to `mebibytes` of zeros after its header.
fn inflating(name: &str, array: &Array, mebibytes: usize) -> Member {
    let head = array.start();
    let packed = deflated(&head, mebibytes);
    let size = (head.len() + (mebibytes << 20)) as u64;
    Member { name: name.to_owned(), method: 8, packed, crc: 0, size: size & 0xffff_ffff }
}

/// Archives of the named matrices. One in twenty has a member that inflates to 2 GiB.
pub(crate) fn archives(matrices: Vec<(String, Array)>) -> BoxedStrategy<Vec<u8>> {
    let count = matrices.len();
    let arrays: Vec<BoxedStrategy<Array>> =
        matrices.iter().map(|(_, array)| sometimes_spoiled(Just(array.clone()))).collect();
    let bomb = prop_oneof![19 => Just(None), 1 => (0..count).prop_map(Some)];
    let members = (arrays, any::<bool>(), bomb).prop_map(move |(arrays, deflate, bomb)| {
        let members =
            arrays.into_iter().zip(&matrices).enumerate().map(|(i, (array, (name, _)))| {
                let name = format!("{name}.npy");
                if bomb == Some(i) {
                    let shape = Array::new("<f8", false, &[1 << 28], Vec::new());
                    return inflating(&name, &shape, 2048);
                }
                member(&name, &array.to_bytes(), deflate)
            });
        archive(&members.collect::<Vec<_>>())
    });
    prop_oneof![members.clone(), spoiled(members)].prop_map(|layout| layout.to_bytes()).boxed()
}
