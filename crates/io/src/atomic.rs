//! Files that are replaced whole: after a crash a file is the complete old or the complete new one.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

use anyhow::Context;
use tempfile::NamedTempFile;

use crate::InputError;

/// Writes a file, or replaces it whole.
///
/// `write` writes into a temporary file in the same folder; the file is then synced to the disk and
/// renamed to `path`. On an error the temporary file is removed and the old file, if any, stays.
///
/// # Errors
/// An [`InputError`] if `path` is a folder, or if its folder is missing or does not accept files.
/// Other errors, for example a full disk or an error of `write`, come with the path as context.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    if path.is_dir() {
        return Err(InputError::new(path, "output", "a folder", "the name of a file").into());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let temporary = temporary_in(folder).map_err(|e| folder_error(folder, e))?;
    fill_and_rename(temporary, path, write)
        .with_context(|| format!("cannot write {}", path.display()))?;
    // The rename is an entry of the folder, so the folder is synced too. Some systems cannot sync a
    // folder. The file is whole there as well; only the rename may be lost in a crash.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

fn temporary_in(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".dsdf-").suffix(".tmp");
    // By default only the owner may read a temporary file. This one becomes an ordinary file, with
    // the permissions that the user's umask leaves.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

fn fill_and_rename(
    temporary: NamedTempFile,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut out = BufWriter::new(temporary);
    write(&mut out)?;
    let temporary = out.into_inner().map_err(std::io::IntoInnerError::into_error)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path)?;
    Ok(())
}

/// The error of a temporary file that cannot be created: wrong input unless the disk is full.
fn folder_error(folder: &Path, error: std::io::Error) -> anyhow::Error {
    let found = match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            return anyhow::Error::from(error).context("cannot write");
        }
        // The text of the error would name the temporary file.
        ErrorKind::NotFound if folder.exists() => "a folder that accepts no files".to_owned(),
        ErrorKind::NotFound => "no such folder".to_owned(),
        ErrorKind::NotADirectory => "a file".to_owned(),
        ErrorKind::PermissionDenied => "no permission".to_owned(),
        kind => kind.to_string(),
    };
    InputError::new(folder, "output folder", found, "a folder that can be written").into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        atomic_write(&path, |out| Ok(out.write_all(b"old")?)).unwrap();
        let failed = atomic_write(&path, |out| {
            out.write_all(b"half")?;
            anyhow::bail!("no room")
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_folder_is_an_input_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = atomic_write(&folder.path().join("no/a.txt"), |_| Ok(())).unwrap_err();
        assert!(error.is::<InputError>());
        let error = atomic_write(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("a folder"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_full_disk_is_no_input_error() {
        let error = folder_error(Path::new("x"), std::io::Error::from(ErrorKind::StorageFull));
        assert!(!error.is::<InputError>());
    }
}
