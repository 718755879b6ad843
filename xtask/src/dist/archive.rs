//! The archive with a static binary.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};
use sweep::measure::{cargo, workspace_root};

use super::trial::{self, TRIAL, built, text_of};

/// The files beside the binary in the archive.
const FILES: [&str; 4] = ["LICENSE-APACHE", "LICENSE-MIT", "README.md", "CHANGELOG.md"];

/// The type of a program header that names a loader of shared libraries (ELF specification 1.2,
/// "Program Header").
const INTERPRETER: u32 = 3;

/// Builds the binary, checks that it is static, packs it into `output`, and tries the archive.
///
/// # Errors
/// If the target or a C compiler for it is missing, or if the build or the trial fails.
pub(super) fn make(target: &str, profile: &str, output: &Path) -> anyhow::Result<()> {
    check_target(target)?;
    check_compiler(target)?;
    let arguments = ["build", "--locked", "--profile", profile, "--target", target];
    cargo(&[&arguments[..], &["--package", "dsdf", "--bin", "dsdf"]].concat(), &[])?;
    let folder = if profile == "dev" { "debug" } else { profile };
    let binary = built().join(target).join(folder).join("dsdf");
    let bytes = std::fs::read(&binary).with_context(|| binary.display().to_string())?;
    ensure!(is_static(&bytes)?, "{}: needs a loader of shared libraries", binary.display());
    let version = text_of(Command::new(&binary).arg("--version"))?;
    let name = format!("dsdf-{}-{target}", env!("CARGO_PKG_VERSION"));
    let staged = output.join(&name);
    if staged.exists() {
        std::fs::remove_dir_all(&staged)?;
    }
    std::fs::create_dir_all(&staged).with_context(|| staged.display().to_string())?;
    std::fs::copy(&binary, staged.join("dsdf"))?;
    for file in FILES {
        std::fs::copy(workspace_root().join(file), staged.join(file)).context(file)?;
    }
    let archive = format!("{name}.tar.gz");
    pack(output, &name, &archive)?;
    std::fs::remove_dir_all(&staged)?;
    try_archive(&output.join(&archive), &name)?;
    println!("{}, static: the trial passes", version.trim());
    trial::tell(&output.join(archive))
}

/// Unpacks an archive in a new folder and runs its binary there, without an environment.
fn try_archive(archive: &Path, name: &str) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    text_of(Command::new("tar").arg("-xzf").arg(archive).current_dir(&folder))?;
    let binary = folder.path().join(name).join("dsdf");
    let mut trial = Command::new(binary);
    let options = TRIAL.map(|(name, value)| format!("--{name}={value}"));
    trial.env_clear().arg("demo").args(options).args(["-o", "demo", "--quiet"]);
    trial.current_dir(&folder);
    text_of(&mut trial)?;
    trial::check(&folder.path().join("demo"))
}

/// Checks that the standard library of a target is installed.
fn check_target(target: &str) -> anyhow::Result<()> {
    let sysroot = text_of(Command::new("rustc").args(["--print", "sysroot"]))?;
    let library = Path::new(sysroot.trim()).join("lib/rustlib").join(target).join("lib");
    ensure!(
        library.is_dir(),
        "{target}: found no standard library of this target, expected one: \
         rustup target add {target}"
    );
    Ok(())
}

/// Checks that there is a C compiler for a target of musl: the allocator is written in C.
fn check_compiler(target: &str) -> anyhow::Result<()> {
    let variable = format!("CC_{}", target.replace('-', "_"));
    if !target.ends_with("-linux-musl") || std::env::var_os(&variable).is_some() {
        return Ok(());
    }
    let processor = target.split('-').next().unwrap_or_default();
    let names = [format!("{processor}-linux-musl-gcc"), "musl-gcc".to_owned()];
    let is_there = |name: &String| Command::new(name).arg("--version").output().is_ok();
    ensure!(
        names.iter().any(is_there),
        "{target}: found no {} and no {}, expected a C compiler for musl: apt install musl-tools, \
         or its name in {variable}",
        names[0],
        names[1]
    );
    Ok(())
}

/// Whether an ELF file of 64 bits and little endian needs no loader of shared libraries.
///
/// # Errors
/// If the file is none.
fn is_static(bytes: &[u8]) -> anyhow::Result<bool> {
    let field = |at: usize, length: usize| -> anyhow::Result<usize> {
        let bytes = bytes.get(at..at + length).context("an ELF file that is cut short")?;
        Ok(bytes.iter().rev().fold(0, |value, byte| value << 8 | usize::from(*byte)))
    };
    ensure!(bytes.starts_with(b"\x7fELF\x02\x01"), "no ELF file of 64 bits, little endian");
    let (start, size, count) = (field(32, 8)?, field(54, 2)?, field(56, 2)?);
    for i in 0..count {
        if field(start + i * size, 4)? == INTERPRETER as usize {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Packs the folder `name` in `output`. The same files give the same bytes.
fn pack(output: &Path, name: &str, archive: &str) -> anyhow::Result<()> {
    let mut tar = Command::new("tar");
    tar.args(["--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--mtime=@0"]);
    tar.args(["-czf", archive, name]).current_dir(output);
    text_of(&mut tar).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with one program header of this type.
    fn elf(kind: u8) -> Vec<u8> {
        let mut bytes = vec![0; 64 + 56];
        bytes[..6].copy_from_slice(b"\x7fELF\x02\x01");
        (bytes[32], bytes[54], bytes[56], bytes[64]) = (64, 56, 1, kind);
        bytes
    }

    #[test]
    fn a_loader_is_found_and_other_files_are_refused() {
        assert!(is_static(&elf(1)).unwrap() && !is_static(&elf(3)).unwrap());
        assert!(is_static(&elf(1)[..66]).is_err() && is_static(b"#!/bin/sh").is_err());
        // This test is linked to the C library of the system.
        if cfg!(all(target_os = "linux", target_env = "gnu", target_endian = "little")) {
            let own = std::fs::read(std::env::current_exe().unwrap()).unwrap();
            assert!(!is_static(&own).unwrap());
        }
    }

    #[test]
    fn a_missing_target_is_named_with_its_command() {
        let error = check_target("x86_64-unknown-plan9").unwrap_err().to_string();
        assert!(error.ends_with("rustup target add x86_64-unknown-plan9"), "{error}");
    }
}
