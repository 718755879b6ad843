//! The text form of a sparse model: a record a line (an image: two), numbers apart by blanks, `#`
//! for comments.

use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use super::{Intrinsics, Registered, Result};
use io::InputError;

fn read(file: &Path) -> Result<String> {
    std::fs::read_to_string(file)
        .map_err(|e| InputError::new(file, "file", e, "a readable text file"))
}

/// One line's words.
struct Line<'a> {
    file: &'a Path,
    number: usize,
    words: std::str::SplitWhitespace<'a>,
}

impl<'a> Line<'a> {
    fn new(file: &'a Path, index: usize, text: &'a str) -> Self {
        Line { file, number: index + 1, words: text.split_whitespace() }
    }

    fn word(&mut self, what: &str) -> Result<&'a str> {
        let at = format!("line {}", self.number);
        self.words.next().ok_or_else(|| InputError::new(self.file, at, "the line's end", what))
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        word.parse()
            .map_err(|_| InputError::new(self.file, format!("line {}", self.number), word, what))
    }

    fn vector(&mut self, what: &str) -> Result<DVec3> {
        Ok(DVec3::new(self.number(what)?, self.number(what)?, self.number(what)?))
    }
}

/// The lines that are neither empty nor comments, with their indices.
fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'))
}

pub(super) fn cameras(file: &Path) -> Result<Vec<Intrinsics>> {
    let text = read(file)?;
    records(&text)
        .map(|(i, line)| {
            let mut line = Line::new(file, i, line);
            let id = line.number("a camera's number")?;
            let model = line.word("a camera model")?.to_owned();
            let size = [line.number("a width in pixels")?, line.number("a height in pixels")?];
            let mut parameters = Vec::new();
            while line.words.clone().next().is_some() {
                parameters.push(line.number("a camera's parameter")?);
            }
            Ok(Intrinsics { id, model, size, parameters })
        })
        .collect()
}

/// An image's second line, its image points, may be empty: it is passed over whatever it holds.
pub(super) fn images(file: &Path) -> Result<Vec<Registered>> {
    let text = read(file)?;
    let mut lines = text.lines().enumerate();
    let mut images = Vec::new();
    while let Some((i, line)) = lines.next() {
        if line.trim().is_empty() || line.trim_start().starts_with('#') {
            continue;
        }
        let mut line = Line::new(file, i, line);
        let _: u64 = line.number("an image's number")?;
        let w = line.number("a quaternion")?;
        let xyz = line.vector("a quaternion")?;
        let translation = line.vector("a translation")?;
        let camera = line.number("a camera's number")?;
        // Names may hold blanks.
        let name = line.words.collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(InputError::new(
                file,
                format!("line {}", i + 1),
                "the line's end",
                "an image's name",
            ));
        }
        images.push(Registered { quaternion: [w, xyz.x, xyz.y, xyz.z], translation, camera, name });
        lines.next();
    }
    Ok(images)
}

pub(super) fn points(file: &Path) -> Result<Vec<DVec3>> {
    let text = read(file)?;
    records(&text)
        .map(|(i, line)| {
            let mut line = Line::new(file, i, line);
            let _: u64 = line.number("a point's number")?;
            line.vector("a point")
        })
        .collect()
}
