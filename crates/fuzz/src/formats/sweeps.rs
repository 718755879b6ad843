//! Sweep files and tables of results.

use proptest::prelude::*;
use serde_json::Value;
use sweep::report::{SHIPPED, shipped};

use crate::case::Case;
use crate::lines::Lines;
use crate::spoil::{sometimes_spoiled, spoiled};
use crate::tree::Tree;

/// A file `sweep.toml`: a shipped sweep with harm.
pub(crate) fn sweep_files() -> BoxedStrategy<Case> {
    let text = |name: &str| shipped(name).unwrap_or_else(|e| panic!("{e}"));
    let tree = |name| Tree::from(toml::from_str::<Value>(&text(name)).unwrap_or_default());
    let trees = SHIPPED.map(tree);
    spoiled(prop::sample::select(trees.to_vec()))
        .prop_map(|tree| Case::default().file("sweep.toml", tree.toml()))
        .boxed()
}

/// A table of results.
fn table(seeds: usize) -> Lines {
    let mut text = "data,gamma,seed,status,reason,converged,chamfer,psnr,loss\n".to_owned();
    for gamma in ["3.0", "6.0"] {
        for seed in 0..seeds {
            text += &format!("pebble,{gamma},{seed},done,,true,0.01{seed},31.5,{seed}\n");
        }
    }
    Lines::new(&text, ',')
}

/// Files `a.csv` and `b.csv`, to be compared.
pub(crate) fn result_files() -> BoxedStrategy<Case> {
    (1..5usize)
        .prop_flat_map(|seeds| (spoiled(Just(table(seeds))), sometimes_spoiled(Just(table(seeds)))))
        .prop_map(|(a, b)| Case::default().file("a.csv", a.to_bytes()).file("b.csv", b.to_bytes()))
        .boxed()
}
