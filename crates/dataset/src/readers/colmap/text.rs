//! The text form of a sparse model: one record a line (an image: two lines), numbers separated by
//! blanks, `#` for comments.

use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use super::records::{CameraRecord, ImageRecord, PointRecord};
use crate::readers::result::Result;
use files::InputError;

fn read(file: &Path) -> Result<String> {
    files::read_text(file, "file", "a readable text file")
}

/// One line, read word by word. `expected` names the next item in error messages.
struct Line<'a> {
    file: &'a Path,
    number: usize,
    text: &'a str,
    words: std::str::SplitWhitespace<'a>,
}

impl<'a> Line<'a> {
    fn new(file: &'a Path, index: usize, text: &'a str) -> Self {
        Line { file, number: index + 1, text, words: text.split_whitespace() }
    }

    fn error(&self, found: &str, expected: &str) -> InputError {
        InputError::new(self.file, format!("line {}", self.number), found, expected)
    }

    fn word(&mut self, expected: &str) -> Result<&'a str> {
        self.words.next().ok_or_else(|| self.error("the line's end", expected))
    }

    fn number<T: FromStr>(&mut self, expected: &str) -> Result<T> {
        let word = self.word(expected)?;
        word.parse().map_err(|_| self.error(word, expected))
    }

    /// The text after the words that were read.
    fn rest(&self) -> String {
        let read = self.text.split_whitespace().count() - self.words.clone().count();
        let word = |text: &'a str| text.trim_start().split_once(char::is_whitespace);
        let rest = (0..read).try_fold(self.text, |text, _| word(text).map(|(_, rest)| rest));
        rest.unwrap_or_default().trim().to_owned()
    }

    fn vector(&mut self, expected: &str) -> Result<DVec3> {
        Ok(DVec3::new(self.number(expected)?, self.number(expected)?, self.number(expected)?))
    }
}

fn is_record(line: &str) -> bool {
    !line.trim().is_empty() && !line.trim_start().starts_with('#')
}

/// The lines that are neither empty nor comments, with their indices.
fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| is_record(line))
}

/// Reads `cameras.txt`: id, model, width, height, parameters.
pub(super) fn cameras(file: &Path) -> Result<Vec<CameraRecord>> {
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
            Ok(CameraRecord { id, model, size, parameters })
        })
        .collect()
}

/// The words of a record of `images.txt` whose name has no blanks.
const RECORD: usize = 10;

/// Reads `images.txt`: id, quaternion, translation, camera id, name. The second line of a record,
/// its image points, is skipped; it may be
/// empty, or missing.
pub(super) fn images(file: &Path) -> Result<Vec<ImageRecord>> {
    let text = read(file)?;
    let mut images = Vec::new();
    let mut is_after_record = false;
    for (i, line) in
        text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with('#'))
    {
        if line.trim().is_empty() || (is_after_record && is_points(line)) {
            is_after_record = false;
        } else {
            images.push(image(Line::new(file, i, line))?);
            is_after_record = true;
        }
    }
    Ok(images)
}

/// Whether a line has image points: numbers only, but not the ten words of a record.
fn is_points(line: &str) -> bool {
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    line.split_whitespace().all(is_number) && line.split_whitespace().count() != RECORD
}

fn image(mut line: Line<'_>) -> Result<ImageRecord> {
    let _: u64 = line.number("an image's number")?;
    let w = line.number("a quaternion")?;
    let xyz = line.vector("a quaternion")?;
    let translation = line.vector("a translation")?;
    let camera = line.number("a camera's number")?;
    // A name may contain blanks, also several in a row.
    let name = line.rest();
    if name.is_empty() {
        return Err(line.error("the line's end", "an image's name"));
    }
    Ok(ImageRecord { quaternion: [w, xyz.x, xyz.y, xyz.z], translation, camera, name })
}

/// Reads `points3D.txt`: id, position, colour, and an error if there is one; the rest of a line is
/// skipped.
pub(super) fn points(file: &Path) -> Result<Vec<PointRecord>> {
    let text = read(file)?;
    records(&text)
        .map(|(i, line)| {
            let mut line = Line::new(file, i, line);
            let _: u64 = line.number("a point's number")?;
            let position = line.vector("a point")?;
            let error = line.words.nth(3).and_then(|word| word.parse().ok());
            // An image and the number of a point in it, for each view.
            let views = line.words.count() / 2;
            Ok(PointRecord { position, error, views })
        })
        .collect()
}
