//! Locks of folders: an empty file in the folder is locked for one process.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use crate::InputError;
use crate::regular::{check_regular, reason};

/// Locks the file `path` for this process, until the returned file is dropped; `None` if another
/// process holds the lock.
///
/// The file is created if it is missing. Its content is not changed.
/// On file systems without locks, nothing is locked.
///
/// # Errors
/// If the file cannot be opened, or is a link or no regular file.
pub fn lock(path: &Path) -> Result<Option<File>, InputError> {
    let expected = "an ordinary file that can be written";
    let refused = |found: String| InputError::new(path, "lock", found, expected);
    // Before opening: opening a device may act on it.
    if let Ok(metadata) = path.symlink_metadata() {
        if metadata.is_symlink() {
            return Err(refused("a link".to_owned()));
        }
        check_regular(metadata.file_type()).map_err(refused)?;
    }
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false);
    // The path may name a link or a pipe by now.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(
        &mut options,
        (rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK).bits() as i32,
    );
    let file = options.open(path).map_err(|e| refused(reason(&e)))?;
    let metadata = file.metadata().map_err(|e| refused(reason(&e)))?;
    check_regular(metadata.file_type()).map_err(refused)?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Ok(None),
        _ => Ok(Some(file)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_excludes_others_and_keeps_the_content_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        std::fs::write(&path, "mine").unwrap();
        let held = lock(&path).unwrap();
        assert!(held.is_some());
        assert!(lock(&path).unwrap().is_none());
        drop(held);
        assert!(lock(&path).unwrap().is_some());
        assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    }

    #[test]
    #[cfg(unix)]
    fn a_link_or_a_pipe_is_refused_and_its_target_keeps_its_content() {
        let folder = tempfile::tempdir().unwrap();
        let (path, target) = (folder.path().join("lock"), folder.path().join("precious"));
        std::fs::write(&target, "content").unwrap();
        std::os::unix::fs::symlink(&target, &path).unwrap();
        assert!(lock(&path).unwrap_err().to_string().contains("found a link"));
        assert_eq!(std::fs::read(&target).unwrap(), b"content");
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
        assert!(lock(&pipe).unwrap_err().to_string().contains("found a pipe"));
    }
}
