//! Files that are either the old or the new one, whatever happens in between.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

use anyhow::Context;

use crate::InputError;

/// Writes a file through a temporary one in the same folder: written, synced, renamed. On an error
/// the temporary is removed and the old file, if any, stays.
///
/// # Errors
/// Wrong input (exit status 2) if the folder is missing or may not be written; any other error, a
/// full disk say, as it is.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    if path.is_dir() {
        return Err(InputError::new(path, "output", "a folder", "a file's name").into());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".dsdf-").suffix(".tmp");
    // Temporary files are private unless told otherwise; this one becomes an ordinary file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder).map_err(|e| unwritable(folder, e))?;
    let failed = || format!("cannot write {}", path.display());
    let mut out = BufWriter::new(temporary);
    write(&mut out).with_context(failed)?;
    let temporary =
        out.into_inner().map_err(std::io::IntoInnerError::into_error).with_context(failed)?;
    temporary.as_file().sync_all().with_context(failed)?;
    temporary.persist(path).with_context(failed)?;
    // The rename itself lives in the folder. Where folders cannot be synced the file is still
    // whole.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// A folder that cannot take a file is wrong input; a disk without room is not.
fn unwritable(folder: &Path, error: std::io::Error) -> anyhow::Error {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            anyhow::Error::from(error).context("cannot write")
        }
        _ => InputError::new(folder, "output folder", error, "a folder that can be written").into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
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
    fn a_missing_folder_is_wrong_input() {
        let folder = tempfile::tempdir().unwrap();
        let error = atomic_write(&folder.path().join("no/a.txt"), |_| Ok(())).unwrap_err();
        assert!(error.is::<InputError>());
        let error = atomic_write(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("a folder"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_full_disk_is_not_wrong_input() {
        let error = unwritable(Path::new("x"), std::io::Error::from(ErrorKind::StorageFull));
        assert!(!error.is::<InputError>());
    }
}
