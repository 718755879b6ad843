#![doc = include_str!("../README.md")]

pub mod campaign;
mod case;
mod child;
mod formats;
mod layout;
mod lines;
mod program;
mod readers;
mod self_test;
mod spoil;
mod tree;
mod verdict;

pub use program::DSDF;
pub use readers::{READERS, Reader, reader};
pub use verdict::Verdict;

use std::path::Path;

use anyhow::{Context, anyhow};
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// Writes case number `index` of a seed into an empty folder. It depends on nothing else.
///
/// # Errors
/// If the generator gives no value, or a file cannot be written.
pub fn write_case(reader: &Reader, seed: u64, index: u64, folder: &Path) -> anyhow::Result<()> {
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    bytes[8..16].copy_from_slice(&index.to_le_bytes());
    let random = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
    let mut runner = TestRunner::new_with_rng(Config::default(), random);
    let tree = reader.strategy().new_tree(&mut runner).map_err(|e| anyhow!("no case: {e}"))?;
    tree.current().write(folder).with_context(|| format!("case {index} of seed {seed}"))
}
