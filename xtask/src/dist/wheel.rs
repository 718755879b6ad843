//! The wheel for Python, which maturin builds.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

use super::trial::{self, TRIAL, text_of};
use sweep::measure::workspace_root;

/// Checks that maturin, and Python with `venv`, are there.
///
/// # Errors
/// If one is missing.
pub(super) fn check_programs() -> anyhow::Result<()> {
    let answers = |program: PathBuf, arguments: &[&str]| {
        Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success())
    };
    ensure!(
        answers(maturin(), &["--version"]),
        "{}: found no maturin, expected one: pip install maturin, or its path in MATURIN",
        maturin().display()
    );
    ensure!(
        answers(python(), &["-c", "import venv, ensurepip"]),
        "{}: found no Python with venv, expected one: apt install python3-venv, or its path in PYTHON",
        python().display()
    );
    Ok(())
}

/// Builds the wheel, tries it in a fresh environment, and moves it to `output`, where it replaces
/// an older one.
///
/// # Errors
/// If the build or the trial fails. `output` is as before then.
pub(super) fn make(profile: &str, output: &Path) -> anyhow::Result<()> {
    let folder = tempfile::tempdir_in(output)?;
    let mut build = Command::new(maturin());
    build.args(["build", "--quiet", "--locked", "--profile", profile]);
    build.args(["--manifest-path", "crates/python/Cargo.toml", "--out"]).arg(folder.path());
    let status = build.current_dir(workspace_root()).status()?;
    ensure!(status.success(), "maturin build: {status}");
    let [wheel] = &wheels(folder.path())?[..] else { bail!("maturin build: not one wheel") };
    let version = try_wheel(wheel)?;
    println!("dsdf {version} for Python: the trial passes");
    let target = output.join(wheel.file_name().context("a wheel without a name")?);
    std::fs::rename(wheel, &target).with_context(|| target.display().to_string())?;
    trial::tell(&target)
}

fn maturin() -> PathBuf {
    program("MATURIN", "maturin")
}

fn python() -> PathBuf {
    program("PYTHON", "python3")
}

/// A program by a variable of the environment, or by its usual name.
fn program(variable: &str, usual: &str) -> PathBuf {
    let Some(given) = std::env::var_os(variable) else { return usual.into() };
    let given = PathBuf::from(given);
    // The build runs in another folder.
    if given.components().count() > 1 {
        std::path::absolute(&given).unwrap_or(given)
    } else {
        given
    }
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
    text_of(Command::new(python()).args(["-m", "venv"]).arg(&environment))?;
    let python = environment.join("bin/python");
    let pip = ["-m", "pip", "--quiet", "--disable-pip-version-check", "install"];
    text_of(Command::new(&python).args(pip).arg(wheel))?;
    let options: String = TRIAL.map(|(name, value)| format!("{name}='{value}', ")).concat();
    let script = format!(
        "import importlib.metadata, dsdf\n\
         dsdf.command('demo', output='demo', {options}quiet=True)\n\
         print(importlib.metadata.version('dsdf'))"
    );
    let mut trial = Command::new(&python);
    trial.args(["-I", "-c", &script]).current_dir(&folder);
    let version = text_of(&mut trial)?;
    trial::check(&folder.path().join("demo"))?;
    Ok(version.trim().to_owned())
}
