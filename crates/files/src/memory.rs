//! The memory that a process may use, and the refusal of work that needs more.

use std::fmt::Display;
use std::path::Path;

use crate::InputError;

/// Refuses work that needs more memory than this process may use.
///
/// `bytes` is an estimate of the memory, and `found` describes the value of `field` that needs it.
/// The memory is that of the machine, or less if a control group or the address space is limited.
/// On systems other than Linux it is unknown, and nothing is refused.
///
/// # Errors
/// If `bytes` is more than the memory.
pub fn check_memory(
    file: impl AsRef<Path>,
    field: impl Display,
    found: impl Display,
    bytes: u64,
) -> Result<(), InputError> {
    match memory_limit() {
        Some(limit) if bytes > limit => {
            let found = format!("{found}, which needs {} of memory", shown(bytes));
            let expected = format!("at most {}, the memory of this machine", shown(limit));
            Err(InputError::new(file, field, found, expected))
        }
        _ => Ok(()),
    }
}

/// A number of bytes for a message, with one decimal.
fn shown(bytes: u64) -> String {
    let bytes = bytes as f64;
    if bytes < 1e9 { format!("{:.1} MB", bytes / 1e6) } else { format!("{:.1} GB", bytes / 1e9) }
}

/// The memory that this process may use, in bytes; `None` on systems other than Linux.
#[cfg(not(target_os = "linux"))]
pub fn memory_limit() -> Option<u64> {
    None
}

/// The memory that this process may use, in bytes; `None` if it is unknown.
#[cfg(target_os = "linux")]
pub fn memory_limit() -> Option<u64> {
    use rustix::process::{Resource, getrlimit};
    let address_space = getrlimit(Resource::As).current;
    linux::machine(Path::new("/")).into_iter().chain(address_space).min()
}

#[cfg(target_os = "linux")]
mod linux {
    use std::fs::read_to_string;
    use std::path::Path;

    /// The least of the machine's memory and the limits of the process's control groups, in bytes.
    /// `root` is the root of the file system.
    pub(super) fn machine(root: &Path) -> Option<u64> {
        let info = read_to_string(root.join("proc/meminfo")).ok()?;
        let total = info.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        let total: u64 = total.trim().strip_suffix(" kB")?.parse().ok()?;
        let groups = read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
        groups.lines().filter_map(|line| of_group(root, line)).chain([total * 1024]).min()
    }

    /// The least limit of a control group and of those above it. `line` is one of
    /// `/proc/self/cgroup`: number, controllers and path, with colons between them.
    ///
    /// Version 2 has no controllers in the line. A container may see its own group at the top and
    /// another path in the line.
    fn of_group(root: &Path, line: &str) -> Option<u64> {
        let mut parts = line.splitn(3, ':').skip(1);
        let (top, name) = match parts.next()? {
            "" => ("sys/fs/cgroup", "memory.max"),
            "memory" => ("sys/fs/cgroup/memory", "memory.limit_in_bytes"),
            _ => return None,
        };
        let path = Path::new(parts.next()?.trim_start_matches('/'));
        let limit = |group: &Path| -> Option<u64> {
            read_to_string(root.join(top).join(group).join(name)).ok()?.trim().parse().ok()
        };
        path.ancestors().filter_map(limit).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_has_the_need_and_the_memory() {
        let error = check_memory("arguments", "--batch", 7, u64::MAX).err();
        let message = error.map(|e| e.to_string());
        assert_eq!(message.is_some(), cfg!(target_os = "linux"));
        if let Some(message) = message {
            assert!(
                message.starts_with("arguments: --batch: found 7, which needs 18446744073.7 GB")
            );
            assert!(message.contains("expected at most"), "{message}");
        }
        assert_eq!(shown(1_500_000), "1.5 MB");
        check_memory("arguments", "--batch", 7, 1 << 20).unwrap();
    }

    /// The limit in a file system with these files.
    #[cfg(target_os = "linux")]
    fn limit_of(files: &[(&str, &str)]) -> Option<u64> {
        let root = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        linux::machine(root.path())
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_least_limit_of_machine_and_control_groups_counts() {
        let total = ("proc/meminfo", "MemTotal:       2000 kB\nMemFree:  1 kB\n");
        assert_eq!(limit_of(&[]), None);
        assert_eq!(limit_of(&[total]), Some(2_048_000));
        let second = ("proc/self/cgroup", "0::/job/step\n");
        let of = |path: &'static str, text: &'static str| (path, text);
        let step = of("sys/fs/cgroup/job/step/memory.max", "max\n");
        assert_eq!(limit_of(&[total, second, step]), Some(2_048_000));
        let job = of("sys/fs/cgroup/job/memory.max", "5000\n");
        assert_eq!(limit_of(&[total, second, step, job]), Some(5000));
        // In a container the group of the process is at the top.
        let top = of("sys/fs/cgroup/memory.max", "4000\n");
        assert_eq!(limit_of(&[total, ("proc/self/cgroup", "0::/../x\n"), top]), Some(4000));
        let first = ("proc/self/cgroup", "5:cpu:/job\n4:memory:/job\n0::/\n");
        let job = of("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "3000\n");
        assert_eq!(limit_of(&[total, first, job]), Some(3000));
        let unlimited = of("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(limit_of(&[total, first, unlimited]), Some(2_048_000));
    }
}
