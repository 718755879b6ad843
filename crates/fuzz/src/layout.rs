//! Binary files as a sequence of fields of known width.

use crate::spoil::{self, Spoil};

/// A field of a binary file.
#[derive(Clone, Debug)]
enum Field {
    /// An integer of `width` bytes.
    Integer { value: u64, width: usize, big_endian: bool },
    /// A number of floating point of 4 or 8 bytes.
    Float { value: f64, width: usize, big_endian: bool },
    /// A text, a magic string, or data.
    Bytes(Vec<u8>),
}

/// The fields of a binary file in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layout {
    fields: Vec<Field>,
    big_endian: bool,
}

impl Layout {
    /// A layout whose numbers have their highest byte first.
    pub(crate) fn big_endian() -> Self {
        Layout { fields: Vec::new(), big_endian: true }
    }

    /// Appends an integer of `width` bytes.
    pub(crate) fn integer(mut self, value: u64, width: usize) -> Self {
        self.fields.push(Field::Integer { value, width, big_endian: self.big_endian });
        self
    }

    /// Appends a number of floating point of `width` bytes, 4 or 8.
    pub(crate) fn float(mut self, value: f64, width: usize) -> Self {
        self.fields.push(Field::Float { value, width, big_endian: self.big_endian });
        self
    }

    /// Appends numbers of floating point of 8 bytes.
    pub(crate) fn doubles(self, values: &[f64]) -> Self {
        values.iter().fold(self, |layout, value| layout.float(*value, 8))
    }

    /// Appends bytes.
    pub(crate) fn bytes(mut self, value: impl Into<Vec<u8>>) -> Self {
        self.fields.push(Field::Bytes(value.into()));
        self
    }

    /// Appends all fields of another layout.
    pub(crate) fn append(mut self, other: Layout) -> Self {
        self.fields.extend(other.fields);
        self
    }

    /// The bytes of the file.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for field in &self.fields {
            match field {
                Field::Integer { value, width, big_endian } => {
                    put(&value.to_le_bytes()[..*width], *big_endian, &mut out);
                }
                Field::Float { value, width: 4, big_endian } => {
                    put(&(*value as f32).to_le_bytes(), *big_endian, &mut out);
                }
                Field::Float { value, big_endian, .. } => {
                    put(&value.to_le_bytes(), *big_endian, &mut out);
                }
                Field::Bytes(bytes) => out.extend(bytes),
            }
        }
        out
    }
}

/// Appends bytes that have their lowest byte first, turned round if `big_endian`.
fn put(bytes: &[u8], big_endian: bool, out: &mut Vec<u8>) {
    if big_endian {
        out.extend(bytes.iter().rev());
    } else {
        out.extend(bytes);
    }
}

impl Spoil for Layout {
    fn spoil(&mut self, place: usize, harm: usize) {
        if self.fields.is_empty() {
            return;
        }
        let (i, count) = (place % self.fields.len(), self.fields.len());
        // One harm in sixteen ends the file at the place.
        if harm % 16 == 15 {
            self.fields.truncate(i);
            return;
        }
        // Another one in sixteen swaps two fields.
        if harm % 16 == 14 {
            self.fields.swap(i, (i + 1) % count);
            return;
        }
        match &mut self.fields[i] {
            Field::Integer { value, .. } => *value = spoil::integer(*value, harm),
            Field::Float { value, .. } => *value = spoil::float(*value, harm),
            Field::Bytes(bytes) => *bytes = spoil::bytes(bytes, harm),
        }
    }
}
