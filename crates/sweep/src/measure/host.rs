//! The machine and the source revision of a measurement.

use std::process::Command;

/// The processor's name, or the architecture where the system does not tell it.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split(':').nth(1));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |name| name.trim().to_owned())
}

/// The files that decide what a program does, as patterns of git.
const CODE: [&str; 7] =
    ["*.rs", "*.toml", "*.py", "Cargo.lock", "crates/*.json", "xtask/*.json", "tests/*.json"];

/// The commit of the source, with `-dirty` if its code differs from it, or `unknown`.
pub fn revision() -> String {
    let git = |arguments: &[&str]| {
        let root = crate::measure::workspace_root();
        let output = Command::new("git").args(arguments).current_dir(root).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(text)
    };
    let Some(commit) = git(&["rev-parse", "--short", "HEAD"]) else { return "unknown".to_owned() };
    let changes = git(&[&["status", "--porcelain", "--"][..], &CODE].concat());
    if changes.is_some_and(|changes| changes.is_empty()) { commit } else { commit + "-dirty" }
}
