//! Reading and replacing whole files.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use files::InputError;

use crate::error::Error;

/// Replaces a file whole: a reader sees the old content or the new one, also after a crash of this
/// process. The content goes to a file with the ending `.part` first.
///
/// # Errors
/// If the folder or the file cannot be written.
pub fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> Result<(), Error> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    std::fs::write(&part, content).map_err(Error::file(path))?;
    std::fs::rename(&part, path).map_err(Error::file(path))
}

/// The largest file that is read, in bytes: 1 GiB.
const MOST_BYTES: u64 = 1 << 30;

/// The content of a regular file. A pipe would make the command wait, and a device has no end.
///
/// # Errors
/// If the file cannot be read, is no regular file, or has more than 1 GiB.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        let kind = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(io::Error::new(ErrorKind::InvalidInput, kind));
    }
    if metadata.len() > MOST_BYTES {
        return Err(io::Error::new(ErrorKind::FileTooLarge, format!("{} bytes", metadata.len())));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(metadata.len()).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a regular file.
///
/// # Errors
/// As [`read`], and if the file is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let text = String::from_utf8(read(path)?);
    text.map_err(|_| io::Error::new(ErrorKind::InvalidData, "bytes that are not UTF-8"))
}

/// The text of a file, or `None` if there is no such file.
///
/// # Errors
/// An [`InputError`] if the file is there and cannot be read as text.
pub fn read_if_present(path: &Path) -> Result<Option<String>, InputError> {
    match read_text(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(InputError::new(path, "file", error, "a file to read")),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn devices_and_folders_are_not_read() {
        let error = |path: &str| read(Path::new(path)).unwrap_err().to_string();
        assert_eq!(error("/dev/zero"), "a pipe or a device");
        assert_eq!(error("/dev"), "a folder");
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert_eq!(read_text(&pipe).unwrap_err().to_string(), "a pipe or a device");
    }
}
