//! Numbers as bytes of binary formats.

#![warn(clippy::cast_possible_truncation)]

/// The bytes of three words.
pub(crate) fn little_endian(words: [u32; 3]) -> [u8; 12] {
    let mut bytes = [0; 12];
    bytes.chunks_exact_mut(4).zip(words).for_each(|(b, w)| b.copy_from_slice(&w.to_le_bytes()));
    bytes
}
