//! The wheel for Python, which maturin builds.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::trial::{self, text_of};
use sweep::measure::workspace_root;

/// Builds the wheel, replaces those in `output`, and tries it in a fresh environment.
///
/// The variables `MATURIN` and `PYTHON` name the programs, otherwise `maturin` and `python3`.
///
/// # Errors
/// If maturin, or Python with venv, is missing, or if the build or the trial fails.
pub(super) fn make(profile: &str, output: &Path) -> anyhow::Result<()> {
    let maturin = program("MATURIN", "maturin");
    ensure!(
        Command::new(&maturin).arg("--version").output().is_ok(),
        "{}: found no such program, expected maturin: pip install maturin, or its path in MATURIN",
        maturin.display()
    );
    for old in wheels(output)? {
        std::fs::remove_file(old)?;
    }
    let mut build = Command::new(maturin);
    build.args(["build", "--quiet", "--locked", "--profile", profile]);
    build.args(["--manifest-path", "crates/python/Cargo.toml", "--out"]).arg(output);
    let status = build.current_dir(workspace_root()).status()?;
    ensure!(status.success(), "maturin build: {status}");
    let [wheel] = &wheels(output)?[..] else { bail!("{}: not one wheel", output.display()) };
    let version = try_wheel(wheel)?;
    println!("dsdf {version} for Python: the trial passes");
    trial::tell(wheel)
}

/// A program by a variable of the environment, or by its usual name.
fn program(variable: &str, usual: &str) -> PathBuf {
    std::env::var_os(variable).unwrap_or_else(|| OsString::from(usual)).into()
}

/// The wheels in a folder.
fn wheels(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let files = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let is_wheel = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "whl");
    Ok(files.flatten().map(|file| file.path()).filter(is_wheel).collect())
}

/// Installs a wheel in a new virtual environment and runs the embedded example there. Returns the
/// version that it says.
fn try_wheel(wheel: &Path) -> anyhow::Result<String> {
    let folder = tempfile::tempdir()?;
    let environment = folder.path().join("environment");
    text_of(Command::new(program("PYTHON", "python3")).args(["-m", "venv"]).arg(&environment))?;
    let python = environment.join("bin/python");
    let pip = ["-m", "pip", "--quiet", "--disable-pip-version-check", "install"];
    text_of(Command::new(&python).args(pip).arg(wheel))?;
    let script = "import importlib.metadata, dsdf\n\
                  dsdf.command('demo', output='demo', views=8, size=32, time='2s', quiet=True)\n\
                  print(importlib.metadata.version('dsdf'))";
    let mut trial = Command::new(&python);
    trial.args(["-I", "-c", script]).current_dir(&folder);
    let version = text_of(&mut trial)?;
    trial::check(&folder.path().join("demo"))?;
    Ok(version.trim().to_owned())
}
