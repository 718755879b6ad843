//! Files that are replaced whole: after a crash a file is the complete old or the complete new one.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use tempfile::NamedTempFile;

use crate::regular::check_regular;
use crate::{InputError, WriteError};

/// The start of the name of a temporary file. The number of the process follows.
const PREFIX: &str = ".dsdf-";

/// The end of the name of a temporary file.
const SUFFIX: &str = ".tmp";

/// Writes a file, or replaces it whole.
///
/// `write` writes into a temporary file in the same folder; the file is then synced to the disk and
/// renamed to `path`. On an error the temporary file is removed and the old file, if any, stays.
///
/// # Errors
/// As [`check_output`], and [`WriteError::File`] for a disk that fills up or an error of `write`.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    write_whole(path, ORDINARY, write)
}

/// As [`atomic_write`], for a file that its owner alone may read, on Unix: a file at `path`, or a link
/// to one, is replaced with its permissions.
///
/// # Errors
/// As [`atomic_write`].
pub fn atomic_write_private(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    write_whole(path, PRIVATE, write)
}

fn write_whole(
    path: &Path,
    mode: u32,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    refuse_path(path)?;
    let folder = folder_of(path);
    let temporary = temporary_in(folder, mode).map_err(|e| folder_error(folder, e))?;
    fill_and_rename(temporary, path, write).map_err(|e| WriteError::of_file(path, e))?;
    // The rename is an entry of the folder, so the folder is synced too. Some systems cannot sync a
    // folder. The file is whole there as well; only the rename may be lost in a crash.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Checks that [`atomic_write`] can write to `path`, before the work for its content.
///
/// A temporary file is created in the folder and removed.
///
/// # Errors
/// [`WriteError::Input`] if `path` is a folder or no possible name, or if its folder is missing or
/// does not accept files. [`WriteError::Folder`] if the disk is full.
pub fn check_output(path: &Path) -> Result<(), WriteError> {
    refuse_path(path)?;
    let folder = folder_of(path);
    temporary_in(folder, ORDINARY).map(drop).map_err(|e| folder_error(folder, e))
}

/// Checks that files can be written in `folder`, which may not exist yet, before the work for them.
///
/// A temporary file is created, in the folder or in the nearest folder above it, and removed.
///
/// # Errors
/// [`WriteError::Input`] if the folder cannot be created or does not accept files.
/// [`WriteError::Folder`] if the disk is full.
pub fn check_output_folder(folder: &Path) -> Result<(), WriteError> {
    refuse_name(folder, "a shorter name of a folder")?;
    let present = folder.ancestors().find(|p| p.symlink_metadata().is_ok());
    let present = present.unwrap_or(Path::new("."));
    temporary_in(present, ORDINARY).map(drop).map_err(|e| folder_error(present, e))
}

/// Removes the temporary files of this process in `folder`, for an exit in the middle of a write.
pub fn remove_own_temporary_files(folder: &Path) {
    remove_temporary_files(folder, |writer| writer == std::process::id());
}

/// Removes the temporary files in `folder` that no running process writes: those of killed
/// processes.
///
/// A file of an earlier process with the number of this one is removed too, so this process must
/// not be writing there.
pub fn remove_abandoned_temporary_files(folder: &Path) {
    remove_temporary_files(folder, |writer| writer == std::process::id() || !is_running(writer));
}

/// Removes the temporary files in `folder` whose process `is_removable` accepts.
fn remove_temporary_files(folder: &Path, is_removable: impl Fn(u32) -> bool) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let ours = writer_of(&entry.file_name()).is_some_and(&is_removable);
        if ours && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            // Another process may have removed it meanwhile.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The process that wrote a temporary file of this name; `None` for other names.
fn writer_of(name: &std::ffi::OsStr) -> Option<u32> {
    let middle = name.to_str()?.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)?;
    middle.split_once('-')?.0.parse().ok()
}

#[cfg(unix)]
fn is_running(process: u32) -> bool {
    use rustix::io::Errno;
    use rustix::process::{Pid, test_kill_process};
    let pid = i32::try_from(process).ok().and_then(Pid::from_raw);
    // A process of another user gives another error.
    pid.is_some_and(|pid| test_kill_process(pid) != Err(Errno::SRCH))
}

#[cfg(not(unix))]
fn is_running(_: u32) -> bool {
    false
}

/// The folder of a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Refuses a path that no file can have, and one of another kind of file, which a rename would
/// replace. A link is replaced.
fn refuse_path(path: &Path) -> Result<(), InputError> {
    let refused = |found: String| InputError::new(path, "output", found, "the name of a file");
    let ends_as_folder = path.as_os_str().as_encoded_bytes().ends_with(b"/");
    if path.is_dir() || path.file_name().is_none() || ends_as_folder {
        return Err(refused("a folder".to_owned()));
    }
    if let Ok(metadata) = path.symlink_metadata()
        && !metadata.is_symlink()
    {
        check_regular(metadata.file_type()).map_err(refused)?;
    }
    refuse_name(path, "a shorter name of a file")
}

/// Refuses a name that is too long or has a zero byte: the system cannot look for it.
fn refuse_name(path: &Path, expected: &str) -> Result<(), InputError> {
    match path.symlink_metadata() {
        Err(e) if matches!(e.kind(), ErrorKind::InvalidFilename | ErrorKind::InvalidInput) => {
            let found = format!("a name that the system refuses ({e})");
            Err(InputError::new(path, "output", found, expected))
        }
        _ => Ok(()),
    }
}

/// The permissions of a file: those that the user's umask leaves, and those of the owner alone.
const ORDINARY: u32 = 0o666;
const PRIVATE: u32 = 0o600;

fn temporary_in(folder: &Path, mode: u32) -> io::Result<NamedTempFile> {
    let prefix = format!("{PREFIX}{}-", std::process::id());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    // By default only the owner may read a temporary file. This one becomes another file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
    #[cfg(not(unix))]
    let _ = mode;
    builder.tempfile_in(folder)
}

fn fill_and_rename(
    temporary: NamedTempFile,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut out = BufWriter::new(temporary);
    write(&mut out)?;
    let temporary = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path)?;
    Ok(())
}

/// The error of a temporary file that cannot be created: wrong input unless the disk is full.
fn folder_error(folder: &Path, error: io::Error) -> WriteError {
    let found = match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            return WriteError::of_folder(folder, error);
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
        atomic_write(&path, |out| out.write_all(b"old")).unwrap();
        let failed = atomic_write(&path, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("no room"))
        });
        let error = failed.unwrap_err();
        assert!(matches!(error, WriteError::File { .. }));
        assert_eq!(error.to_string(), format!("cannot write {}", path.display()));
        let cause = std::error::Error::source(&error).map(ToString::to_string);
        assert_eq!(cause.as_deref(), Some("no room"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_folder_is_an_input_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = atomic_write(&folder.path().join("no/a.txt"), |_| Ok(())).unwrap_err();
        assert!(error.input().is_some());
        let error = atomic_write(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("a folder"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_full_disk_is_no_input_error() {
        let error = folder_error(Path::new("x"), io::Error::from(ErrorKind::StorageFull));
        assert!(error.input().is_none() && error.to_string().ends_with("in x"), "{error}");
    }

    #[test]
    fn outputs_that_cannot_be_written_are_found_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let in_folder = |name: &str| folder.path().join(name);
        let long = "x".repeat(300);
        std::fs::write(in_folder("file"), "").unwrap();
        for (path, found) in [
            (in_folder(&long), "refuses"),
            (in_folder("none/a.png"), "no such folder"),
            (in_folder("file/a.png"), "a file"),
            (folder.path().to_owned(), "a folder"),
        ] {
            let error = check_output(&path).unwrap_err();
            assert!(error.input().is_some() && error.to_string().contains(found), "{error}");
            assert!(atomic_write(&path, |_| Ok(())).unwrap_err().input().is_some());
        }
        for (path, found) in [(in_folder(&long), "refuses"), (in_folder("file/a"), "a file")] {
            let error = check_output_folder(&path.join("more")).unwrap_err();
            assert!(error.input().is_some() && error.to_string().contains(found), "{error}");
        }
        check_output(&in_folder("a.png")).unwrap();
        check_output_folder(&in_folder("a/b/c")).unwrap();
        check_output_folder(folder.path()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_or_a_device_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe.npy");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
        for (path, found) in [(pipe.as_path(), "a pipe"), (Path::new("/dev/null"), "a device")] {
            let error = check_output(path).unwrap_err().to_string();
            assert!(error.contains(found), "{error}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn temporary_files_of_ended_processes_are_removed_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let ended = child.id();
        child.wait().unwrap();
        let (own, parent) = (std::process::id(), std::os::unix::process::parent_id());
        let files = [
            (format!(".dsdf-{ended}-a.tmp"), false),
            (format!(".dsdf-{own}-b.tmp"), false),
            (format!(".dsdf-{parent}-c.tmp"), true),
            (".dsdf-mine.tmp".to_owned(), true),
            (format!("dsdf-{ended}-a.tmp"), true),
            ("notes.tmp".to_owned(), true),
        ];
        let write =
            || files.iter().for_each(|(f, _)| std::fs::write(folder.path().join(f), "").unwrap());
        write();
        remove_own_temporary_files(folder.path());
        for (name, _) in &files {
            assert_eq!(folder.path().join(name).exists(), !name.contains("-b."), "{name}");
        }
        write();
        remove_abandoned_temporary_files(folder.path());
        for (name, stays) in &files {
            assert_eq!(folder.path().join(name).exists(), *stays, "{name}");
        }
    }
}
