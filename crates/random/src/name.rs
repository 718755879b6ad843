//! The names of random decisions.

use std::fmt;

/// The bit that the numbers of [`Name::other`] have, and the numbers of [`Name::new`] have not.
const OTHER: u64 = 1 << 63;

/// The name of a random decision: streams of different names share no number.
///
/// Each crate declares the names of its own decisions beside their use:
///
/// ```
/// # use random::Name;
/// const COINS: Name = Name::other("sides of a coin");
/// ```
///
/// In dsdf, they have numbers ([`Name::new`]), and `cargo xtask style` refuses a text or a number
/// that two names share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Name {
    text: &'static str,
    number: u64,
}

impl Name {
    /// A name inside dsdf. The bits of a stream depend on the number alone: another text keeps
    /// them.
    ///
    /// # Panics
    /// If the number is 2^63 or more.
    pub const fn new(text: &'static str, number: u64) -> Self {
        assert!(number & OTHER == 0, "the number of a name is below 2^63");
        Name { text, number }
    }

    /// A name outside dsdf, or of a test. Its number is a hash of its text (64-bit FNV-1a), and
    /// differs from all numbers inside dsdf.
    pub const fn other(text: &'static str) -> Self {
        let (bytes, mut hash, mut i) = (text.as_bytes(), 0xcbf2_9ce4_8422_2325_u64, 0);
        while i < bytes.len() {
            hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
            i += 1;
        }
        Name { text, number: hash | OTHER }
    }

    /// The number, which tells streams apart.
    pub(crate) const fn number(self) -> u64 {
        self.number
    }
}

/// The text.
impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_another_name_is_a_hash_of_its_text() {
        // Values of the reference implementation, with the highest bit.
        for (text, hash) in [("", 0xcbf2_9ce4_8422_2325), ("a", 0xaf63_dc4c_8601_ec8c)] {
            assert_eq!(Name::other(text).number(), hash);
        }
        assert_eq!(Name::other("foobar").number(), 0x8594_4171_f739_67e8);
        assert_eq!(Name::other("foobar").to_string(), "foobar");
    }

    #[test]
    #[should_panic(expected = "below 2^63")]
    fn a_large_number_is_refused() {
        let _ = Name::new("large", u64::MAX);
    }
}
