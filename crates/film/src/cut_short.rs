//! The error of an image that is cut short.

use std::io::ErrorKind;
use std::path::Path;

use files::InputError;

/// The error of a file whose end is missing; `why` is what the decoder says.
pub(crate) fn cut_short(path: &Path, why: &str) -> InputError {
    InputError::new(path, "image", format!("an image that is cut short{why}"), "a whole image")
}

/// Whether an end of file is in the chain of causes. Decoders report missing bytes either with the
/// kind `UnexpectedEof` or in the text of an error only.
pub(crate) fn is_cut_short(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut cause = Some(error);
    while let Some(error) = cause {
        let is_end = error
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == ErrorKind::UnexpectedEof);
        let text = error.to_string();
        let says_end = ["unexpected end of file", "failed to fill whole buffer", "missing bytes"]
            .iter()
            .any(|t| text.contains(t));
        if is_end || says_end {
            return true;
        }
        cause = error.source();
    }
    false
}
