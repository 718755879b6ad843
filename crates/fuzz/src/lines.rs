//! Texts of lines and words: tables, camera files, headers.

use crate::spoil::{self, Spoil, repetitions};

/// Lines of words.
#[derive(Clone, Debug)]
pub(crate) struct Lines {
    lines: Vec<Vec<Vec<u8>>>,
    separator: u8,
}

/// Wrong words.
const WORDS: [&str; 26] = [
    "",
    "0",
    "-1",
    "-9223372036854775808",
    "2147483648",
    "4294967295",
    "1000000000",
    "1152921504606846976",
    "18446744073709551616",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "1e300",
    "1e-320",
    "1e999",
    "x",
    "#",
    "\"",
    "\u{1b}[31m",
    "/dev/zero",
    "../../..",
    "1/2/3",
    "//",
    "0x10",
    "\u{7f}",
];

impl Lines {
    /// The lines of a text. Words are separated by `separator`.
    pub(crate) fn new(text: &str, separator: char) -> Self {
        let words = |line: &str| line.split(separator).map(|w| w.as_bytes().to_vec()).collect();
        Lines { lines: text.lines().map(words).collect(), separator: separator as u8 }
    }

    /// The text; each line ends with a line break.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for line in &self.lines {
            out.extend(line.join(&self.separator));
            out.push(b'\n');
        }
        out
    }
}

impl Spoil for Lines {
    fn spoil(&mut self, place: usize, harm: usize) {
        let words: usize = self.lines.iter().map(Vec::len).sum();
        let mut word = place % words.max(1);
        let line = self.lines.iter().position(|line| {
            let here = word < line.len();
            word -= if here { 0 } else { line.len() };
            here
        });
        let Some(line) = line else { return };
        match harm % (WORDS.len() + 12) {
            0 => drop(self.lines.remove(line)),
            1 => self.lines.insert(line, self.lines[line].clone()),
            2 => drop(self.lines[line].remove(word)),
            3 => self.lines[line].insert(word, b"1".to_vec()),
            4 => self.lines.truncate(line),
            5 => {
                let text = self.lines[line][word].clone();
                self.lines[line] = vec![text.clone(); repetitions(text.len(), 20_000)];
            }
            6 => {
                let length: usize = self.lines[line].iter().map(Vec::len).sum();
                self.lines = vec![self.lines[line].clone(); repetitions(length, 1500)];
            }
            other @ 7..12 => {
                let changed = spoil::bytes(&self.lines[line][word], 4 + other - 7);
                self.lines[line][word] = changed;
            }
            other => self.lines[line][word] = WORDS[other - 12].as_bytes().to_vec(),
        }
    }
}
