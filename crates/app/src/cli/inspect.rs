//! `dsdf inspect`.

use std::path::PathBuf;

use clap::Args;

use super::common::{Global, check_extension};
use super::fit::parse_bounds;
use dataset::LoadOptions;
use dataset::inspect::{inspect, overlay};
use io::write_image;

/// Show what was understood of a data set: cameras, units, bounding sphere, coverage, and an
/// overlay picture.
#[derive(Args, Debug)]
pub(crate) struct Inspect {
    /// The data set
    dataset: PathBuf,
    /// The overlay picture to write: the sphere's outline and axes on every view
    #[arg(short, long, default_value = "inspect.png")]
    output: PathBuf,
    /// Bounding sphere x,y,z,radius in world units, instead of the one found
    #[arg(long, value_parser = parse_bounds, allow_hyphen_values = true)]
    bounds: Option<[f64; 4]>,
    /// Read images at 1/N of their size
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    downscale: u32,
}

impl Inspect {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        check_extension(&self.output, &["png", "exr", "npy"])?;
        let dataset = dataset::load(&self.dataset, &LoadOptions { downscale: self.downscale })?;
        let asked = self
            .bounds
            .map(|[x, y, z, radius]| field::Sphere { center: glam::DVec3::new(x, y, z), radius });
        let from = match (asked.is_some(), dataset.bounds.is_some()) {
            (true, _) => "as asked",
            (false, true) => "from the data set",
            (false, false) => "estimated from cameras and background",
        };
        let (bounds, background) = dataset::surroundings(&dataset, asked);
        write_image(&self.output, &overlay(&dataset, &bounds))?;
        let report = inspect(&dataset, &bounds, &background, from);
        global.report(&report, || format!("{report}\npicture      {}", self.output.display()))
    }
}
