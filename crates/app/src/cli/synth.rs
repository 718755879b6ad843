//! `dsdf synth`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::{Global, mover};
use dataset::synth::{Options, synthesise};
use scene::SceneFile;

/// Make a data set of posed images of a scene around its object, with exact ground truth.
#[derive(Args, Debug)]
pub(crate) struct Synth {
    /// The scene file; its camera is not used
    scene: PathBuf,
    /// The data set's folder to write
    #[arg(short, long)]
    output: PathBuf,
    /// Views to fit; an eighth as many are held out beside them
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=10000))]
    views: u32,
    /// Size of the images, WIDTHxHEIGHT
    #[arg(long, default_value = "256x256", value_parser = parse_size)]
    size: [u32; 2],
    /// Samples a pixel
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Serialize)]
struct Report {
    dataset: PathBuf,
    views: u32,
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parts: Option<Vec<u32>> = text.split('x').map(|n| n.parse().ok()).collect();
    match parts.as_deref() {
        Some([w, h]) if (1..=65535).contains(w) && (1..=65535).contains(h) => Ok([*w, *h]),
        _ => Err("expected WIDTHxHEIGHT in pixels".to_owned()),
    }
}

impl Synth {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let scene = SceneFile::load(&self.scene)?;
        let bar = global.progress("synth");
        let options =
            Options { views: self.views as usize, size: self.size, spp: self.spp, seed: self.seed };
        synthesise(&scene, &self.scene, &self.output, &options, &mover(&bar))?;
        bar.finish_and_clear();
        let report = Report { dataset: self.output.clone(), views: self.views };
        global.report(&report, || format!("{} views: {}", self.views, self.output.display()))
    }
}
