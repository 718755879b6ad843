//! Standard output.

/// Writes to standard output. A reader that closed the pipe is no error.
pub(crate) fn print(text: &str) {
    let _ = std::io::Write::write_all(&mut std::io::stdout(), text.as_bytes());
}
