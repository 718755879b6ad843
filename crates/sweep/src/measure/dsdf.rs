//! Building the `dsdf` binary, running its commands, and reading their JSON.

use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::error::{Error, ProcessFailure};
use crate::measure::image::Image;
use crate::measure::{npy, workspace_root};

/// Builds `dsdf` in the profile `release` and returns its path.
///
/// # Errors
/// If the build fails.
pub fn build() -> Result<PathBuf, Error> {
    build_package("dsdf", "release")
}

/// Builds the binary of a package in a profile of the workspace, and returns its path.
///
/// The binary of a package has its name, and that of `dsdf-fuzz` is `fuzz`.
///
/// # Errors
/// If the build fails.
pub fn build_package(package: &str, profile: &str) -> Result<PathBuf, Error> {
    let name = package.strip_prefix("dsdf-").filter(|name| *name == "fuzz").unwrap_or(package);
    crate::measure::cargo(
        &["build", "--profile", profile, "--package", package, "--bin", name],
        &[],
    )?;
    let target = workspace_root()
        .join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    // The folder of the profile `dev` has another name.
    let folder = if profile == "dev" { "debug" } else { profile };
    Ok(target.join(folder).join(format!("{name}{}", std::env::consts::EXE_SUFFIX)))
}

/// The names of the workspace's packages.
///
/// # Errors
/// If `cargo metadata` fails.
pub fn packages() -> Result<Vec<String>, Error> {
    let output = crate::measure::cargo_command(&["metadata", "--no-deps", "--format-version", "1"])
        .output()?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        return Err(Error::content(format!("cargo metadata: {}", message.trim())));
    }
    let metadata: Value = serde_json::from_slice(&output.stdout).map_err(Error::content)?;
    let packages = metadata["packages"].as_array().ok_or_else(Error::lacks("packages"))?;
    Ok(packages.iter().filter_map(|package| package["name"].as_str().map(str::to_owned)).collect())
}

/// Runs a command of the binary, with `--json --quiet` added, and returns the JSON that it prints.
///
/// # Errors
/// If the command fails, with its standard error as the message.
pub fn run_json(binary: &Path, arguments: &[&str]) -> Result<Value, Error> {
    let output = Command::new(binary).args(arguments).args(["--json", "--quiet"]).output()?;
    report(arguments, &output)
}

/// The JSON that a command printed.
fn report(arguments: &[&str], output: &Output) -> Result<Value, Error> {
    if !output.status.success() {
        let (command, message) = (arguments.join(" "), String::from_utf8_lossy(&output.stderr));
        let reason = format!("dsdf {command}: {message}");
        return Err(ProcessFailure::failed(reason).into());
    }
    serde_json::from_slice(&output.stdout).map_err(Error::content)
}

/// A number of `/proc/PROCESS/status`, in MiB, for a key like `"VmRSS:"`.
///
/// `None` if the process has ended, or if the system has no such file.
pub fn memory(process: u32, key: &str) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}

/// Runs a command of the binary as [`run_json`] does, and returns its processor time in seconds, too:
/// of a command with one thread, its wall time without the time that it waited for a core. A neighbour
/// that shares the core's caches or units still makes it longer.
///
/// The time is `None` where the system has no `/proc`.
///
/// # Errors
/// If the command fails, with its standard error as the message.
pub fn run_json_timed(binary: &Path, arguments: &[&str]) -> Result<(Value, Option<f64>), Error> {
    // Files and not pipes: nobody reads until the end.
    let (mut printed, mut messages) = (tempfile::tempfile()?, tempfile::tempfile()?);
    let child = Command::new(binary)
        .args(arguments)
        .args(["--json", "--quiet"])
        .stdout(printed.try_clone()?)
        .stderr(messages.try_clone()?)
        .spawn();
    let mut child = child.map_err(Error::action("cannot start dsdf".to_owned()))?;
    // The system forgets the time with the process: it is read until the end.
    let mut seconds = None;
    while child.try_wait()?.is_none() {
        seconds = processor_seconds(child.id()).or(seconds);
        std::thread::sleep(INTERVAL);
    }
    let status = child.wait()?;
    let read = |file: &mut std::fs::File| {
        let mut bytes = Vec::new();
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).map(|_| bytes)
    };
    let output = Output { status, stdout: read(&mut printed)?, stderr: read(&mut messages)? };
    Ok((report(arguments, &output)?, seconds))
}

/// The time between two readings of a process's time.
const INTERVAL: std::time::Duration = std::time::Duration::from_millis(100);

/// The processor time of a process so far, from `/proc/PROCESS/stat`.
fn processor_seconds(process: u32) -> Option<f64> {
    /// Of Linux, on all machines of today.
    const TICKS_PER_SECOND: f64 = 100.0;
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name of the program, in brackets, may have spaces. User and system time are the numbers 12
    // and 13 behind it, from 1.
    let (_, numbers) = text.rsplit_once(')')?;
    let number = |text: &str| text.parse::<f64>().ok();
    let ticks = numbers.split_whitespace().skip(11).take(2).map(number).sum::<Option<f64>>()?;
    Some(ticks / TICKS_PER_SECOND)
}

/// A way to run commands of `dsdf`: a path runs them without limits, a sweep adds limits of time
/// and memory.
pub trait RunDsdf {
    /// Runs a command and returns the JSON that it prints.
    ///
    /// # Errors
    /// If the command fails.
    fn run_json(&self, arguments: &[&str]) -> Result<Value, Error>;
}

impl RunDsdf for Path {
    fn run_json(&self, arguments: &[&str]) -> Result<Value, Error> {
        run_json(self, arguments)
    }
}

/// The result of `dsdf gradient`: derivative images with their cost.
#[derive(Debug)]
pub struct DerivativeImages {
    /// One image for each parameter, in the order of the parameters.
    pub images: Vec<Image>,
    /// Wall time of the computation, in seconds.
    pub seconds: f64,
    /// Field evaluations: values, gradients and Hessian–vector products, added up.
    pub evaluations: u64,
}

/// Runs `dsdf gradient` on a scene.
///
/// `wrt` holds JSON pointers to the scene's parameters. `flags` are further options.
///
/// # Errors
/// If the command fails, or if its files or its JSON are not of the expected form.
pub fn gradient(
    program: &(impl RunDsdf + ?Sized),
    scene: &Value,
    wrt: &[String],
    flags: &[&str],
) -> Result<DerivativeImages, Error> {
    let folder = tempfile::tempdir()?;
    let (file, out) = (folder.path().join("scene.json"), folder.path().join("g.npy"));
    std::fs::write(&file, scene.to_string())?;
    let (file_name, out_name) = (file.to_string_lossy(), out.to_string_lossy());
    let mut arguments = vec!["gradient", &file_name, "-o", &out_name];
    arguments.extend(wrt.iter().flat_map(|pointer| ["--wrt", pointer]));
    arguments.extend(flags);
    let report = program.run_json(&arguments)?;
    // One parameter has the given file name; several have the pointer in their file names.
    let image = |pointer: &String| {
        if wrt.len() == 1 {
            return npy::read_image(&out);
        }
        let suffix = pointer.trim_start_matches('/').replace('/', "_");
        npy::read_image(&folder.path().join(format!("g.{suffix}.npy")))
    };
    let kinds = ["value", "gradient", "hessian_vector"];
    Ok(DerivativeImages {
        images: wrt.iter().map(image).collect::<Result<_, Error>>()?,
        seconds: report["seconds"].as_f64().ok_or_else(Error::lacks("seconds in the report"))?,
        evaluations: kinds.iter().filter_map(|kind| report["evaluations"][kind].as_u64()).sum(),
    })
}
