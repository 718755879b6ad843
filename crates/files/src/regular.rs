//! Opening and reading input files: regular files only, and not more than memory can hold.

use std::fs::{File, FileType, OpenOptions};
use std::io::{ErrorKind, Read};
use std::path::Path;

use crate::InputError;
use crate::memory::check_memory;

/// Bytes of memory for each byte of an input file: its content, and the data that are made of it.
const MEMORY_PER_BYTE: u64 = 8;

/// Opens a regular file for reading. Also returns its length in bytes.
///
/// Other files are refused before they are opened: a pipe may never end, and a device may act.
/// `field` and `expected` are the parts of the error.
///
/// # Errors
/// If the file is missing, cannot be opened, is no regular file, or is one of `/proc` or `/sys`.
pub fn open(path: &Path, field: &str, expected: &str) -> Result<(File, u64), InputError> {
    let refused = |found: String| InputError::new(path, field, found, expected);
    let reason = |e: std::io::Error| refused(reason(&e));
    check_regular(std::fs::metadata(path).map_err(reason)?.file_type()).map_err(refused)?;
    let mut options = OpenOptions::new();
    options.read(true);
    // The path may name a pipe by now: do not wait for its writer.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(
        &mut options,
        rustix::fs::OFlags::NONBLOCK.bits() as i32,
    );
    let file = options.open(path).map_err(reason)?;
    let metadata = file.metadata().map_err(reason)?;
    check_regular(metadata.file_type()).map_err(refused)?;
    if is_of_kernel(&file) {
        return Err(refused("a file that the system makes up, as in /proc".to_owned()));
    }
    Ok((file, metadata.len()))
}

/// Reads a whole regular file; see [`open`].
///
/// # Errors
/// As [`open`], and if the file cannot be read, or an eighth of the memory is too small for it.
pub fn read(path: &Path, field: &str, expected: &str) -> Result<Vec<u8>, InputError> {
    read_within(path, field, expected, MEMORY_PER_BYTE)
}

/// Like [`read`], for a file of UTF-8 text.
///
/// # Errors
/// As [`read`], and if the file is not UTF-8.
pub fn read_text(path: &Path, field: &str, expected: &str) -> Result<String, InputError> {
    text(path, field, expected, read(path, field, expected)?)
}

/// Like [`read`], if reader and content need `memory_per_byte` bytes for each byte of the file.
pub(crate) fn read_within(
    path: &Path,
    field: &str,
    expected: &str,
    memory_per_byte: u64,
) -> Result<Vec<u8>, InputError> {
    let (file, length) = open(path, field, expected)?;
    let memory = length.saturating_mul(memory_per_byte);
    check_memory(path, field, format!("a file of {length} bytes"), memory)?;
    let mut bytes = Vec::with_capacity(length as usize);
    // A file that grows meanwhile is read up to the length that was checked.
    file.take(length)
        .read_to_end(&mut bytes)
        .map_err(|e| InputError::new(path, field, reason(&e), expected))?;
    Ok(bytes)
}

/// The content of a file as text: UTF-8, with a byte order mark or without, or UTF-16 with one.
pub(crate) fn text(
    path: &Path,
    field: &str,
    expected: &str,
    bytes: Vec<u8>,
) -> Result<String, InputError> {
    let bytes = match bytes.strip_prefix(b"\xef\xbb\xbf") {
        Some(rest) => rest.to_vec(),
        None => bytes,
    };
    if let Some(text) = utf_16(&bytes) {
        return Ok(text);
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let found = format!("a byte that is not UTF-8, after {at} bytes");
        InputError::new(path, field, found, expected)
    })
}

/// The text of a file that starts with a byte order mark of UTF-16, which PowerShell writes.
fn utf_16(bytes: &[u8]) -> Option<String> {
    let (rest, is_little) = match bytes {
        [0xff, 0xfe, rest @ ..] => (rest, true),
        [0xfe, 0xff, rest @ ..] => (rest, false),
        _ => return None,
    };
    let (units, end) = rest.as_chunks::<2>();
    let unit = |unit: &[u8; 2]| match is_little {
        true => u16::from_le_bytes(*unit),
        false => u16::from_be_bytes(*unit),
    };
    let text = char::decode_utf16(units.iter().map(unit)).collect::<Result<String, _>>().ok();
    text.filter(|_| end.is_empty())
}

/// The reason of a failed access, for a message.
pub(crate) fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "no such file".to_owned(),
        _ => error.to_string(),
    }
}

/// The error names the kind of a file that is not regular.
pub(crate) fn check_regular(kind: FileType) -> Result<(), String> {
    if kind.is_file() {
        return Ok(());
    }
    if kind.is_dir() {
        return Err("a folder".to_owned());
    }
    Err(special(kind).to_owned())
}

#[cfg(unix)]
fn special(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn special(_: FileType) -> &'static str {
    "no regular file"
}

/// Whether the file is in `/proc` or `/sys`. These files look regular and have no true length.
#[cfg(target_os = "linux")]
fn is_of_kernel(file: &File) -> bool {
    /// `SYSFS_MAGIC` of Linux.
    const SYSFS: rustix::fs::FsWord = 0x6265_6572;
    let kinds = [rustix::fs::PROC_SUPER_MAGIC, SYSFS];
    rustix::fs::fstatfs(file).is_ok_and(|system| kinds.contains(&system.f_type))
}

#[cfg(not(target_os = "linux"))]
fn is_of_kernel(_: &File) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// The message of the refusal of a path, which must come within a second.
    fn refusal(path: &Path) -> String {
        let (sender, receiver) = std::sync::mpsc::channel();
        let path = path.to_owned();
        std::thread::spawn(move || sender.send(read(&path, "image", "an image")));
        let read = receiver.recv_timeout(std::time::Duration::from_secs(1)).expect("no answer");
        read.map(|bytes| bytes.len()).expect_err("a file that is read").to_string()
    }

    #[test]
    fn pipes_sockets_devices_and_folders_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, socket) = (folder.path().join("pipe"), folder.path().join("socket"));
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        for (path, found) in [
            (pipe.as_path(), "a pipe"),
            (&socket, "a socket"),
            (Path::new("/dev/zero"), "a device"),
            (folder.path(), "a folder"),
            (&folder.path().join("none"), "no such file"),
        ] {
            let expected = format!("{}: image: found {found}, expected an image", path.display());
            assert_eq!(refusal(path), expected);
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn files_that_the_system_makes_up_are_refused() {
        for path in ["/proc/self/status", "/proc/kmsg", "/proc/self/mem"] {
            let message = refusal(Path::new(path));
            // Some need permissions that the test may lack.
            let known = ["as in /proc", "ermission", "ermitted"];
            assert!(known.iter().any(|k| message.contains(k)), "{message}");
        }
        let kernel = Path::new("/sys/kernel/mm/transparent_hugepage/enabled");
        if kernel.exists() {
            assert!(refusal(kernel).contains("as in /proc"));
        }
    }

    #[test]
    fn a_file_larger_than_the_memory_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        // Some file systems have no files of this length.
        if File::create(&path).unwrap().set_len(1 << 43).is_ok() && cfg!(target_os = "linux") {
            let message = refusal(&path);
            assert!(message.contains("the memory of this machine"), "{message}");
        }
    }

    #[test]
    fn text_that_is_not_utf_8_is_refused_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, b"{\"a\": \xff}").unwrap();
        let message = read_text(&path, "file", "JSON").unwrap_err().to_string();
        assert!(message.contains("not UTF-8, after 6 bytes"), "{message}");
        let utf_16 = |text: &str| text.encode_utf16().collect::<Vec<u16>>();
        let little = utf_16("\u{feff}gö").iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
        let big = utf_16("\u{feff}gö").iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<_>>();
        for bytes in ["\u{feff}gö".as_bytes(), &little, &big] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read_text(&path, "file", "JSON").unwrap(), "gö");
        }
        std::fs::write(&path, &little[..little.len() - 1]).unwrap();
        assert!(read_text(&path, "file", "JSON").is_err());
        std::fs::write(&path, "good").unwrap();
        assert_eq!(read_text(&path, "file", "JSON").unwrap(), "good");
    }
}
