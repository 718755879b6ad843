//! Errors as a user meets them: one line, and an exit status.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Wrong input: the file, the field in it, what was found and what was expected. Exit status 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {field}: found {found}, expected {expected}", file.display())]
pub struct InputError {
    /// The file (or folder) at fault.
    pub file: PathBuf,
    /// The place in the file: a key, a JSON pointer, a line.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What should stand there.
    pub expected: String,
}

impl InputError {
    /// An input error; line breaks in what was found are flattened, so that the message stays one line.
    pub fn new(file: impl AsRef<Path>, field: impl Display, found: impl Display, expected: impl Display) -> Self {
        InputError {
            file: file.as_ref().to_owned(),
            field: one_line(field),
            found: one_line(found),
            expected: one_line(expected),
        }
    }
}

fn one_line(text: impl Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A run that Ctrl-C ended; what it had is saved. Exit status 130.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// The exit status for an error: 2 for wrong input, 130 after Ctrl-C, 1 for anything else.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if error.downcast_ref::<InputError>().is_some() {
        2
    } else if error.downcast_ref::<Interrupted>().is_some() {
        130
    } else {
        1
    }
}

/// A NaN or an infinity met along a ray, with where it was met.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the field is not finite along the ray of camera {camera} through film position {u}, from {eye} towards {direction}"
)]
pub struct InvalidField {
    /// The index of the camera.
    pub camera: usize,
    /// The film position, in pixels.
    pub u: glam::DVec2,
    /// Where the ray starts, in world units.
    pub eye: glam::DVec3,
    /// The ray's unit direction.
    pub direction: glam::DVec3,
}
