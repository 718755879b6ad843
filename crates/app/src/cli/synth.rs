//! `dsdf synth`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::common::{ARGUMENTS, Global, RENDER_BYTES, check_film};
use scene::SceneFile;
use scene::synth::{Options, synthesise};

/// Arguments of `dsdf synth`.
#[derive(Args, Debug)]
pub(crate) struct Synth {
    /// Scene file (JSON); its camera is ignored
    scene: PathBuf,
    /// Data set folder to write
    #[arg(short, long)]
    output: PathBuf,
    /// Number of training views; an eighth as many are held out in addition
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=10000))]
    views: u32,
    /// Width and height of the images in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "256x256", value_parser = parse_size)]
    size: [u32; 2],
    /// Samples per pixel
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// The result of `dsdf synth`.
#[derive(Serialize)]
struct SynthReport {
    /// The data set folder.
    dataset: PathBuf,
    /// Number of training views.
    views: u32,
}

/// Width and height of an image, in pixels, from text of the form `256x128`.
fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parts: Option<Vec<u32>> = text.split('x').map(|n| n.parse().ok()).collect();
    match parts.as_deref() {
        Some([w, h]) if (1..=65535).contains(w) && (1..=65535).contains(h) => Ok([*w, *h]),
        _ => Err("expected WIDTHxHEIGHT, each 1 to 65535 pixels".to_owned()),
    }
}

impl Synth {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let folders = ["train", "test", "masks/train", "masks/test"];
        global.will_write_in(&self.output, &folders)?;
        check_film(Path::new(ARGUMENTS), "--size", self.size, 1, RENDER_BYTES)?;
        let scene = SceneFile::load(&self.scene)?;
        let bar = global.progress("synth");
        let options =
            Options { views: self.views as usize, size: self.size, spp: self.spp, seed: self.seed };
        synthesise(&scene, &self.scene, &self.output, &options, &bar.mover())?;
        bar.finish_and_clear();
        let report = SynthReport { dataset: self.output.clone(), views: self.views };
        global.report(&report, || format!("{} views: {}", self.views, self.output.display()))
    }
}
