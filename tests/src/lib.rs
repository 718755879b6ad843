#![doc = include_str!("../README.md")]

pub mod browser;
pub mod compose;
pub mod corner;
pub mod input;

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// The workspace's root folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(Path::to_owned).unwrap_or_default()
}

/// A file of the shared reference data, which lies beside the workspace.
///
/// If there is no such file, the function prints a line to standard error and returns `None`.
pub fn shared(path: &str) -> Option<PathBuf> {
    let file = root().join("../shared").join(path);
    if file.exists() {
        return Some(file);
    }
    // The test harness hides the output of `eprintln!`.
    let _ = writeln!(
        std::io::stderr(),
        "SKIPPED: {path} is not here; this test needs the shared references"
    );
    None
}

/// The first of these programs that works. A call is a program and its arguments, and must succeed.
///
/// If none works, the function prints a line to standard error and returns `None`.
///
/// # Panics
/// If none can, and the environment has `DSDF_REQUIRE=programs`, as in `cargo xtask ci`.
pub fn installed(name: &str, calls: &[&[&str]]) -> Option<String> {
    let works = |call: &&&[&str]| {
        let output = Command::new(call[0]).args(&call[1..]).output();
        output.is_ok_and(|output| output.status.success())
    };
    if let Some(call) = calls.iter().find(works) {
        return Some(call[0].to_owned());
    }
    let required = std::env::var_os("DSDF_REQUIRE").is_some_and(|value| value == "programs");
    assert!(!required, "{name} is not installed, and DSDF_REQUIRE asks for it");
    let _ = writeln!(std::io::stderr(), "SKIPPED: {name} is not installed");
    None
}

/// The path of `dsdf`, built once in the profile of the tests.
///
/// # Panics
/// If the build fails.
pub fn binary() -> PathBuf {
    program("dsdf")
}

/// The path of a package's program, built once in the profile of the tests: the binary with the
/// name of the package.
///
/// # Panics
/// If the build fails.
pub fn program(package: &str) -> PathBuf {
    static FOLDER: LazyLock<PathBuf> = LazyLock::new(build);
    FOLDER.join(format!("{package}{}", std::env::consts::EXE_SUFFIX))
}

/// Builds all programs in the profile of this test, and returns their folder.
///
/// With the whole workspace and one of its tests, Cargo selects the features that `cargo test
/// --workspace` has selected. Every library is there already.
fn build() -> PathBuf {
    // A test is target/PROFILE/deps/NAME.
    let test = std::env::current_exe().unwrap_or_else(|e| panic!("the path of the test: {e}"));
    let folder = test.ancestors().nth(2).unwrap_or_else(|| panic!("no folder above the test"));
    let profile = match folder.file_name().and_then(OsStr::to_str) {
        Some("debug") => "dev",
        Some(profile) => profile,
        None => panic!("{}: not the folder of a profile", folder.display()),
    };
    let status = Command::new(env!("CARGO"))
        .args(["build", "--profile", profile, "--workspace", "--bins", "--test", "bad_input"])
        .current_dir(root())
        .status();
    assert!(status.is_ok_and(|s| s.success()), "cargo build of the programs");
    folder.to_owned()
}

/// Runs `dsdf` with these arguments and `--quiet`.
///
/// # Panics
/// If it cannot be started.
pub fn dsdf<S: AsRef<OsStr>>(arguments: &[S]) -> Output {
    let output = Command::new(binary()).args(arguments).arg("--quiet").output();
    output.unwrap_or_else(|e| panic!("cannot start dsdf: {e}"))
}

/// Runs `dsdf` and checks that it succeeds.
///
/// # Panics
/// If it fails, with its standard error.
pub fn dsdf_ok<S: AsRef<OsStr>>(arguments: &[S]) {
    let output = dsdf(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Runs `dsdf` with `--json` and returns the JSON that it prints.
///
/// # Panics
/// If it fails, or if its output is not JSON.
pub fn dsdf_json<S: AsRef<OsStr>>(arguments: &[S]) -> serde_json::Value {
    program_json(&binary(), arguments)
}

/// Runs a program with the commands of `dsdf` with `--json`, and returns the JSON that it prints.
///
/// # Panics
/// If it fails, or if its output is not JSON.
pub fn program_json<S: AsRef<OsStr>>(program: &Path, arguments: &[S]) -> serde_json::Value {
    let output = Command::new(program).args(arguments).args(["--json", "--quiet"]).output();
    let output = output.unwrap_or_else(|e| panic!("cannot start {}: {e}", program.display()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("no JSON: {e}"))
}

/// The numbers of a float32 `.npy` file of version 1, in the order of the file.
///
/// # Panics
/// If there is no such file, or if it is cut short.
pub fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}
