//! Files in the safetensors format that are written tensor by tensor.
//!
//! `safetensors::serialize` holds all bytes of a file in memory. A file of splines has 19 MB.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Write};

use field::Real;
use safetensors::SafeTensorError;
use safetensors::tensor::{Dtype, View};

/// Writes the elements of a tensor, as little-endian bytes.
pub type Elements<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

/// A tensor of a [`TensorFile`].
pub struct Tensor<'a> {
    /// The name in the file.
    pub name: String,
    /// The type of its elements.
    pub dtype: Dtype,
    /// Its sizes.
    pub shape: Vec<usize>,
    /// Its elements.
    pub elements: Elements<'a>,
}

impl<'a> Tensor<'a> {
    /// A tensor with one size.
    pub fn vector(name: &str, dtype: Dtype, length: usize, elements: Elements<'a>) -> Self {
        Tensor { name: name.to_owned(), dtype, shape: vec![length], elements }
    }
}

impl std::fmt::Debug for Tensor<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Tensor { name, dtype, shape, .. } = self;
        f.debug_struct("Tensor")
            .field("name", name)
            .field("dtype", dtype)
            .field("shape", shape)
            .finish_non_exhaustive()
    }
}

/// Elements that are little-endian bytes already.
pub fn bytes<'a>(bytes: impl Into<Cow<'a, [u8]>>) -> Elements<'a> {
    let bytes = bytes.into();
    Box::new(move |out| out.write_all(&bytes))
}

/// Numbers that [`numbers`] turns into bytes at a time: their bytes stay in the innermost cache.
const PIECE: usize = 1024;

/// Numbers as elements, in their own precision.
pub fn numbers<R: Real>(numbers: &[R]) -> Elements<'_> {
    match dtype_of::<R>() {
        Dtype::F32 => single(numbers),
        _ => Box::new(|out| write_pieces(numbers, out, |v| v.to_double().to_le_bytes())),
    }
}

/// Numbers as elements in single precision.
pub fn single<R: Real>(numbers: &[R]) -> Elements<'_> {
    Box::new(|out| write_pieces(numbers, out, |v| (v.to_double() as f32).to_le_bytes()))
}

/// The type of numbers of this precision.
pub fn dtype_of<R: Real>() -> Dtype {
    if size_of::<R>() == size_of::<f32>() { Dtype::F32 } else { Dtype::F64 }
}

fn write_pieces<R: Real, const N: usize>(
    numbers: &[R],
    out: &mut dyn Write,
    bytes_of: impl Fn(R) -> [u8; N],
) -> io::Result<()> {
    let mut bytes = [[0; N]; PIECE];
    for piece in numbers.chunks(PIECE) {
        bytes.iter_mut().zip(piece).for_each(|(bytes, number)| *bytes = bytes_of(*number));
        out.write_all(bytes[..piece.len()].as_flattened())?;
    }
    Ok(())
}

/// A tensor whose elements follow the header later.
struct Announced<'a> {
    tensor: &'a Tensor<'a>,
}

impl View for Announced<'_> {
    fn dtype(&self) -> Dtype {
        self.tensor.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.tensor.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&[])
    }

    fn data_len(&self) -> usize {
        let bits = self.tensor.shape.iter().product::<usize>() * self.tensor.dtype.bitsize();
        bits / 8
    }
}

/// A file in the safetensors format, ready to be written. Equal content gives equal bytes.
#[derive(Debug)]
pub struct TensorFile<'a> {
    /// The length of the header, and the header.
    header: Vec<u8>,
    /// In the order of their elements in the file.
    tensors: Vec<Tensor<'a>>,
}

impl<'a> TensorFile<'a> {
    /// A file with these tensors and metadata.
    ///
    /// # Errors
    /// If two tensors have one name, or the header is too large.
    pub fn new(
        mut tensors: Vec<Tensor<'a>>,
        metadata: HashMap<String, String>,
    ) -> Result<Self, SafeTensorError> {
        let views = tensors.iter().map(|tensor| (&tensor.name, Announced { tensor }));
        let bytes = safetensors::serialize(views, Some(metadata))?;
        let entries: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(&bytes[LENGTH..])?;
        let place = |tensor: &Tensor<'_>| entries[&tensor.name]["data_offsets"][0].as_u64();
        tensors.sort_by_key(place);
        Ok(TensorFile { header: header(&entries)?, tensors })
    }

    /// Writes the file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&self.header)?;
        self.tensors.iter().try_for_each(|tensor| (tensor.elements)(out))
    }

    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // A vector takes all bytes.
        let _ = self.write(&mut bytes);
        bytes
    }
}

/// Bytes of the length in front of a header.
const LENGTH: usize = size_of::<u64>();

/// The length and the header, with its entries sorted by name.
///
/// The `safetensors` crate writes them in the order of a hash map with a random seed. Sorted, equal
/// models give equal files.
fn header(entries: &BTreeMap<String, serde_json::Value>) -> serde_json::Result<Vec<u8>> {
    let mut text = serde_json::to_vec(entries)?;
    text.resize(text.len().next_multiple_of(LENGTH), b' ');
    Ok([&(text.len() as u64).to_le_bytes()[..], &text].concat())
}
