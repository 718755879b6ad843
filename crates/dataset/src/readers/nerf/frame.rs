//! The values of a frame. A key of the frame overrides the same key of the file.

use std::path::Path;

use serde_json::Value;

use crate::readers::result::Result;
use files::InputError;
use files::json::shown;

/// One frame, and the file that has the defaults of all frames.
pub(super) struct Frame<'a> {
    pub(super) file: &'a Path,
    pub(super) root: &'a Value,
    pub(super) frame: &'a Value,
    /// `frames/N`, for messages.
    pub(super) pointer: String,
}

impl Frame<'_> {
    /// The value of the frame, or else of the file; null if neither has the key.
    pub(super) fn value(&self, key: &str) -> &Value {
        if self.frame[key].is_null() { &self.root[key] } else { &self.frame[key] }
    }

    /// A finite number of the frame, or else of the file.
    pub(super) fn number(&self, key: &str) -> Result<Option<f64>> {
        let value = self.value(key);
        if value.is_null() {
            return Ok(None);
        }
        let number = value.as_f64().filter(|v| v.is_finite());
        number.map(Some).ok_or_else(|| {
            let in_frame = !self.frame[key].is_null();
            let place = if in_frame { self.place(key) } else { key.to_owned() };
            InputError::new(self.file, place, shown(value), "a finite number")
        })
    }

    pub(super) fn place(&self, key: &str) -> String {
        format!("{}/{key}", self.pointer)
    }

    /// The error of a key of the frame.
    pub(super) fn error(&self, key: &str, expected: &str) -> InputError {
        InputError::new(self.file, self.place(key), shown(&self.frame[key]), expected)
    }
}
