//! The machine and the source revision of a measurement.

use std::process::Command;

/// The processor's name, or the architecture where the system does not tell it.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split(':').nth(1));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |name| name.trim().to_owned())
}

/// The revision of the source by `git describe --always --dirty`, or `unknown`.
pub fn revision() -> String {
    let output = Command::new("git")
        .args(["describe", "--always", "--dirty"])
        .current_dir(crate::measure::workspace_root())
        .output();
    let revision =
        output.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned()).unwrap_or_default();
    if revision.is_empty() { "unknown".to_owned() } else { revision }
}
