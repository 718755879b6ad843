//! `dsdf inspect`.

use std::path::PathBuf;

use clap::Args;
use field::Sphere;
use glam::DVec3;

use super::common::Global;
use dataset::LoadOptions;
use dataset::inspect::{inspect, overlay};
use fit::parse_bounds;
use io::write_image;

/// Arguments of `dsdf inspect`.
#[derive(Args, Debug)]
pub(crate) struct Inspect {
    /// Data set folder
    dataset: PathBuf,
    /// Overlay image to write: every view with the axes and the outline of the bounding sphere
    #[arg(short, long, default_value = "inspect.png")]
    output: PathBuf,
    /// Bounding sphere x,y,z,radius in world units, instead of the estimated one
    #[arg(long, value_parser = parse_bounds, allow_hyphen_values = true)]
    bounds: Option<[f64; 4]>,
    /// Read images at 1/N of their width and height
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    downscale: u32,
}

impl Inspect {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        global.will_write(&self.output, &["png", "exr", "npy"])?;
        let dataset = dataset::load(&self.dataset, &LoadOptions { downscale: self.downscale })?;
        let given =
            self.bounds.map(|[x, y, z, radius]| Sphere { center: DVec3::new(x, y, z), radius });
        let source = match (given.is_some(), dataset.bounds.is_some()) {
            (true, _) => "as asked",
            (false, true) => "from the data set",
            (false, false) => "estimated from cameras and background",
        };
        let (bounds, background) = dataset::surroundings(&dataset, given);
        write_image(&self.output, &overlay(&dataset, &bounds))?;
        let report = inspect(&dataset, &bounds, &background, source);
        global.report(&report, || format!("{report}\npicture      {}", self.output.display()))
    }
}
