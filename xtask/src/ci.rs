//! `cargo xtask ci`: every check of a change, as the continuous integration runs it.

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Child, Command};
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, ensure};
use sweep::measure::{cargo, workspace_root};

use crate::style;

/// The profile of the checks: optimised, with overflow checks and debug assertions.
const PROFILE: [&str; 2] = ["--profile", "ci"];

/// Tests fail, and do not skip, where a program is missing that `.ci/run` installs.
const REQUIRE: (&str, &str) = ("DSDF_REQUIRE", "programs");

/// Runs every check and stops at the first that fails.
///
/// Work that leaves a part of the processors idle runs beside other work: the installation of the
/// Python packages beside the build; the tests of Python and of Slurm, and the wheel and the archive
/// of `dist` with their trials, beside the tests of Rust.
///
/// # Errors
/// If a check fails, or a program cannot be started.
pub(crate) fn run() -> anyhow::Result<()> {
    style::run()?;
    cargo(&["fmt", "--all", "--check"], &[])?;
    let packages = Beside::start("python-install", "bash crates/python/ci.sh install")?;
    // The tests, and the programs with the same features, as the tests ask for them.
    with_profile(&["test", "--workspace", "--no-run"], &[])?;
    with_profile(&["build", "--workspace", "--bins", "--test", "bad_input"], &[])?;
    packages.wait()?;
    let others = Beside::start(
        "python-slurm-dist",
        "DSDF_XTASK=target/ci/xtask bash crates/python/ci.sh build && bash crates/python/ci.sh test && \
         bash xtask/tests/slurm.sh target/ci/dsdf && \
         target/ci/xtask dist --only archive --profile ci --output target/ci/dist",
    )?;
    with_profile(&["test", "--workspace"], &[REQUIRE])?;
    cargo(
        &["clippy", "--workspace", "--all-targets", PROFILE[0], PROFILE[1], "--", "-D", "warnings"],
        &[],
    )?;
    with_profile(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    others.wait()
}

/// Runs a command of cargo in the profile of the checks.
fn with_profile(arguments: &[&str], environment: &[(&str, &str)]) -> anyhow::Result<()> {
    Ok(cargo(&[arguments, &PROFILE].concat(), environment)?)
}

/// A script that runs beside other work. Its output is printed at its end, or when a check fails.
struct Beside {
    child: Option<Child>,
    log: PathBuf,
}

impl Beside {
    fn start(name: &str, script: &str) -> anyhow::Result<Self> {
        let folder = workspace_root().join("target");
        fs::create_dir_all(&folder)?;
        let log = folder.join(format!("{name}.log"));
        let mut command = Command::new("bash");
        command.args(["-c", script]).current_dir(workspace_root());
        let output = File::create(&log)?;
        command.stdout(output.try_clone()?).stderr(output);
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().with_context(|| format!("cannot start {script}"))?;
        Ok(Beside { child: Some(child), log })
    }

    /// Waits for the end of the script.
    fn wait(mut self) -> anyhow::Result<()> {
        let Some(mut child) = self.child.take() else { return Ok(()) };
        let status = child.wait()?;
        self.print();
        ensure!(status.success(), "{}: {status}", self.log.display());
        Ok(())
    }

    fn print(&self) {
        print!("{}", fs::read_to_string(&self.log).unwrap_or_default());
    }
}

impl Drop for Beside {
    /// Ends the script and the programs that it started.
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        let group = format!("-{}", child.id());
        // Both may have ended.
        let _ = Command::new("kill").args(["--", &group]).status();
        sleep(Duration::from_millis(100));
        let _ = child.kill();
        let _ = child.wait();
        self.print();
    }
}
