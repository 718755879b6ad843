//! `dsdf eval`.

mod points;
mod report;
mod views;

use std::path::{Path, PathBuf};

use clap::Args;

use super::common::{Global, as_fitted, option_error};
use super::cut::{CullOptions, Subject, views_of_run};
use super::mesh::mesh_of_run;
use dataset::Dataset;
use files::InputError;
use fit::{MaskUse, Model, RunFile};
use inspect::surroundings;
use mesh::{Mesh, read_mesh};
use points::PointOptions;

pub(super) use report::EvalReport;
pub(super) use views::compare_views;

/// Arguments of `dsdf eval`.
#[derive(Args, Debug)]
pub(crate) struct Eval {
    /// Run folder
    run: PathBuf,
    /// Data set folder [default: the data set of the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// True surface (.ply, .obj, .glb or .stl), in the units of the data set
    #[arg(long, help_heading = "Shape")]
    mesh: Option<PathBuf>,
    #[command(flatten)]
    reference: PointOptions,
    #[command(flatten)]
    culling: CullOptions,
    /// Print the errors of each held-out view; --json always has them
    #[arg(long, help_heading = "Views")]
    views: bool,
    /// Folder for a picture of each held-out view: photograph, render, normals, error
    #[arg(long, help_heading = "Views", value_name = "FOLDER")]
    pictures: Option<PathBuf>,
    /// Samples per pixel
    #[arg(help_heading = "Views")]
    #[arg(long, default_value_t = SAMPLES,
          value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Grid cells along the diameter of the bounding sphere, for the mesh of the run
    #[arg(help_heading = "Shape")]
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=2048))]
    resolution: u32,
}

impl Eval {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        self.refuse(global)?;
        let file = RunFile::load(&self.run)?;
        let model = Model::load(&self.run, &file)?;
        let truth = self.mesh.as_deref().map(read_surface).transpose()?;
        let points = self.reference.read()?;
        let other = self.dataset.as_deref();
        let mut dataset = views_of_run(&file, other)?;
        let radius = radius_of(&file, &dataset);
        as_fitted(&self.run, &model, &file, &mut dataset, other.is_some(), global)?;
        let bar = global.progress("eval");
        let (views, pictures) = (&dataset.test, self.pictures.as_deref());
        let mut report = compare_views(&model, &file, views, self.spp, pictures, &bar.mover())?;
        bar.finish_and_clear();
        if truth.is_some() || points.is_some() {
            let cells = self.resolution as usize;
            let bar = global.progress("mesh");
            let mesh = mesh_of_run(&model, &file, cells, &bar.mover());
            bar.finish_and_clear();
            let run = self.run.as_path();
            let subject = Subject { model: &model, run, file: &file, dataset: other, cells };
            let (mesh, cut) = self.culling.apply(mesh, &subject, &dataset, global)?;
            report.cut = cut;
            if let Some(truth) = truth {
                report.add_mesh(&mesh, &truth, radius);
            }
            if let Some(points) = points {
                let place = (&dataset, &file.sphere());
                self.reference.compare(&mesh, points, place, &mut report)?;
            }
        }
        // The images are the background alone, whatever their PSNR is.
        if report.is_empty {
            let run = self.run.display();
            anyhow::bail!("{run}: the run has no surface in a held-out view");
        }
        global.report(&report, || match self.views && report.views > 0 {
            true => format!("{}\n{}", report.table(), report::table(&report.per_view)),
            false => report.table(),
        })
    }

    /// Refuses options without use, and a folder that cannot be written.
    fn refuse(&self, global: &Global) -> anyhow::Result<()> {
        let is_compared = self.mesh.is_some() || self.reference.points.is_some();
        if self.culling.is_active() && !is_compared {
            let found = "no mesh to compare with".to_owned();
            return Err(option_error("cull", found, "--mesh or --points too").into());
        }
        self.pictures.as_deref().map_or(Ok(()), |folder| global.will_write_in(folder, &[]))
    }
}

/// The radius of the data set's bounding sphere: that of the run, unless the user gave another one.
/// So runs with other spheres have comparable errors.
fn radius_of(file: &RunFile, dataset: &Dataset) -> f64 {
    match file.options.bounds {
        None => file.sphere().radius,
        Some(_) => {
            let is_cut_out = file.masks == MaskUse::Coverage;
            let found = surroundings(dataset, None, is_cut_out);
            if is_cut_out { found } else { found.with_matches(dataset) }.sphere.radius
        }
    }
}

/// Samples per pixel of a held-out view.
pub(super) const SAMPLES: u32 = 4;

/// Reads the true surface.
///
/// # Errors
/// If it cannot be read, or none of its faces has an area.
fn read_surface(path: &Path) -> Result<Mesh, InputError> {
    let mesh = read_mesh(path)?;
    if mesh.area() > 0.0 {
        return Ok(mesh);
    }
    let found = "only faces without area";
    Err(InputError::new(path, "faces", found, "a surface with an area"))
}
