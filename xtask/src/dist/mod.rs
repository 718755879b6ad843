//! `cargo xtask dist`: an archive with a static binary, and a wheel for Python.
//!
//! Both are tried as a user has them, by the embedded example: the archive in a folder of its own,
//! without an environment, and the wheel in a new virtual environment, for which pip gets NumPy.

mod archive;
mod trial;
mod wheel;

use std::path::PathBuf;

use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};

/// What is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Product {
    /// An archive with a static binary
    Archive,
    /// A wheel for Python 3.9 and later
    Wheel,
}

/// Arguments of `cargo xtask dist`.
#[derive(Args)]
pub(crate) struct Dist {
    /// Target of the binary [default: that of musl for this processor]
    #[arg(long, value_name = "TRIPLE")]
    target: Option<String>,
    /// Make only one of both
    #[arg(long, value_enum, value_name = "PRODUCT")]
    only: Option<Product>,
    /// Profile of cargo
    #[arg(long, default_value = "dist")]
    profile: String,
    /// Folder for the archive and the wheel [default: target/dist]
    #[arg(short, long)]
    output: Option<PathBuf>,
}

impl Dist {
    /// Builds the archive and the wheel, tries both, and prints their sizes and SHA-256.
    ///
    /// # Errors
    /// If a target, a compiler or maturin is missing, or if a step fails.
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        ensure!(
            self.target.is_none() || self.only != Some(Product::Wheel),
            "--target: found it with --only wheel, expected it for the archive alone"
        );
        if self.only != Some(Product::Archive) {
            wheel::check_programs()?;
        }
        let output = self.output.clone().unwrap_or_else(|| trial::built().join("dist"));
        let output = std::path::absolute(output)?;
        std::fs::create_dir_all(&output).with_context(|| output.display().to_string())?;
        if self.only != Some(Product::Wheel) {
            let default = || format!("{}-unknown-linux-musl", std::env::consts::ARCH);
            let target = self.target.clone().unwrap_or_else(default);
            archive::make(&target, &self.profile, &output)?;
        }
        if self.only != Some(Product::Archive) {
            wheel::make(&self.profile, &output)?;
        }
        Ok(())
    }
}
