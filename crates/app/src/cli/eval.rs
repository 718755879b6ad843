//! `dsdf eval`.

mod points;
mod views;

use std::path::{Path, PathBuf};

use clap::Args;
use export::cut::CutReport;
use serde::Serialize;

use super::common::{Global, as_fitted, option_error};
use super::cut::{CullOptions, Subject, views_of_run};
use super::mesh::mesh_of_run;
use dataset::Dataset;
use files::InputError;
use fit::{MaskUse, Model, RunFile};
use inspect::surroundings;
use mesh::{Mesh, read_mesh};
use metrics::compare;
use points::PointOptions;

pub(super) use views::{ViewErrors, compare_views};

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

/// The errors of a run. A metric is `None` if the data set or the command line has no reference for
/// it.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct EvalReport {
    /// PSNR in dB, mean over the held-out views.
    pub(super) psnr: Option<f64>,
    /// PSNR in dB inside the object's masks, mean over the held-out views that have one.
    psnr_masked: Option<f64>,
    /// Structural similarity, mean over the held-out views, with the pixels that masks leave out.
    ssim: Option<f64>,
    /// Intersection over union of the masks, mean over the held-out views that have one.
    mask_iou: Option<f64>,
    /// Chamfer distance to the true surface: the mean of both directions, in data set units.
    chamfer: Option<f64>,
    /// Chamfer distance as a fraction of the data set's bounding radius.
    chamfer_relative: Option<f64>,
    /// F-score at [`F_THRESHOLD`].
    f_score: Option<f64>,
    /// Mean |n·n′| of the normals of nearest points.
    normal_consistency: Option<f64>,
    /// Mean angle between the normals of nearest points, in degrees.
    normal_error: Option<f64>,
    /// Like `normal_error`, the median.
    normal_error_median: Option<f64>,
    /// Mean distance from points of the reconstruction to the reference points, up to the cap.
    accuracy: Option<f64>,
    /// Mean distance from the reference points to points of the reconstruction, up to the cap.
    completeness: Option<f64>,
    /// The mean of accuracy and completeness.
    overall: Option<f64>,
    /// Like `accuracy`, the median.
    accuracy_median: Option<f64>,
    /// Like `completeness`, the median.
    completeness_median: Option<f64>,
    /// The part of the points of the reconstruction beyond the cap, 0 to 1.
    accuracy_beyond_cap: Option<f64>,
    /// The part of the reference points beyond the cap, 0 to 1.
    completeness_beyond_cap: Option<f64>,
    /// Number of held-out views.
    views: usize,
    /// The errors of each held-out view.
    per_view: Vec<ViewErrors>,
    /// The parts that `--cull` removed from the mesh of the run.
    cut: Vec<CutReport>,
    /// Whether there are held-out views, and none shows a surface.
    #[serde(skip)]
    is_empty: bool,
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
                self.reference.compare(&mesh, points, file.sphere().radius, &mut report)?;
            }
        }
        // The images are the background alone, whatever their PSNR is.
        if report.is_empty {
            let run = self.run.display();
            anyhow::bail!("{run}: the run has no surface in a held-out view");
        }
        global.report(&report, || match self.views && report.views > 0 {
            true => format!("{}\n{}", report.table(), views::table(&report.per_view)),
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
        Some(_) => surroundings(dataset, None, file.masks == MaskUse::Coverage).sphere.radius,
    }
}

/// Samples per pixel of a held-out view.
pub(super) const SAMPLES: u32 = 4;

/// Number of points sampled on each surface.
const SURFACE_SAMPLES: usize = 100_000;

/// The threshold of the F-score, in bounding radii.
const F_THRESHOLD: f64 = 0.01;

impl EvalReport {
    /// Adds the comparison of a run's mesh with the true surface. `radius` is the bounding radius,
    /// in data set units. A mesh without faces leaves the metrics `None`.
    pub(super) fn add_mesh(&mut self, mesh: &Mesh, truth: &Mesh, radius: f64) {
        if mesh.faces.is_empty() {
            return;
        }
        let c = compare(mesh, truth, SURFACE_SAMPLES, F_THRESHOLD * radius);
        self.chamfer = Some(c.chamfer);
        self.chamfer_relative = Some(c.chamfer / radius);
        self.f_score = Some(c.f_score);
        self.normal_consistency = Some(c.normal_consistency);
        self.normal_error = Some(c.normal_error);
        self.normal_error_median = Some(c.normal_error_median);
    }

    /// The report as a table, one metric per line.
    pub(super) fn table(&self) -> String {
        let units = "data set units";
        let rows = [
            ("PSNR", self.psnr, "dB"),
            ("PSNR in the masks", self.psnr_masked, "dB"),
            ("SSIM", self.ssim, ""),
            ("mask IoU", self.mask_iou, ""),
            ("Chamfer", self.chamfer, units),
            ("Chamfer / bounding radius", self.chamfer_relative.map(|c| 100.0 * c), "%"),
            ("F-score at 1 % of the bounding radius", self.f_score, ""),
            ("normal consistency", self.normal_consistency, ""),
            ("normal error", self.normal_error, "degrees"),
            ("normal error, median", self.normal_error_median, "degrees"),
        ];
        let of_points = [
            ("accuracy, to points", self.accuracy, units),
            ("accuracy, median", self.accuracy_median, units),
            ("accuracy, beyond the cap", self.accuracy_beyond_cap.map(|c| 100.0 * c), "%"),
            ("completeness, from points", self.completeness, units),
            ("completeness, median", self.completeness_median, units),
            ("completeness, beyond the cap", self.completeness_beyond_cap.map(|c| 100.0 * c), "%"),
            ("overall", self.overall, units),
        ];
        let is_compared = self.accuracy_beyond_cap.is_some();
        let rows = rows.iter().chain(of_points.iter().filter(|_| is_compared));
        let line = |(name, value, unit): &(&str, Option<f64>, &str)| {
            let value = value.map_or("-".to_owned(), |v| format!("{v:.4}"));
            format!("{name:<38} {value:>10} {unit}")
        };
        let mut lines: Vec<String> = rows.map(line).collect();
        if self.views == 0 {
            lines.insert(0, "no held-out view: PSNR, SSIM and mask IoU need one".to_owned());
        }
        lines.extend(self.cut.iter().map(CutReport::text));
        lines.join("\n")
    }
}

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
