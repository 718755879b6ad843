//! `dsdf eval`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::Global;
use super::mesh::mesh_of_run;
use dataset::{LoadOptions, View};
use fit::{Model, RunFile, Solid};
use mesh::read_mesh;
use metrics::{compare, mask_iou, psnr_where, ssim};
use render::render;

/// Arguments of `dsdf eval`.
#[derive(Args, Debug)]
pub(crate) struct Eval {
    /// Run folder
    run: PathBuf,
    /// Data set folder [default: the data set of the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// True surface (.ply, .obj, .glb or .stl), in the units of the data set
    #[arg(long)]
    mesh: Option<PathBuf>,
    /// Samples per pixel
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    spp: u32,
    /// Grid cells along the diameter of the bounding sphere, for the mesh of the run
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=2048))]
    resolution: u32,
}

/// The errors of a run. A metric is `None` if the data set or the command line has no reference for
/// it.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct EvalReport {
    /// PSNR in dB, mean over the held-out views.
    psnr: Option<f64>,
    /// Structural similarity, mean over the held-out views, with the pixels that masks leave out.
    ssim: Option<f64>,
    /// Intersection over union of the masks, mean over the held-out views that have one.
    mask_iou: Option<f64>,
    /// Chamfer distance to the true surface: the mean of both directions, in data set units.
    chamfer: Option<f64>,
    /// Chamfer distance as a fraction of the bounding radius.
    chamfer_relative: Option<f64>,
    /// F-score at [`F_THRESHOLD`].
    f_score: Option<f64>,
    /// Mean |n·n′| of the normals of nearest points.
    normal_consistency: Option<f64>,
    /// Number of held-out views.
    views: usize,
    /// Whether there are held-out views, and none shows a surface.
    #[serde(skip)]
    is_empty: bool,
}

impl Eval {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let file = RunFile::load(&self.run)?;
        let model = Model::load(&self.run, &file)?;
        let truth = self.mesh.as_deref().map(read_mesh).transpose()?;
        let path = self.dataset.as_deref().unwrap_or(&file.dataset);
        let options = LoadOptions { downscale: file.downscale() };
        let dataset = file.prepare(dataset::load(path, &options)?);
        let bar = global.progress("eval");
        let mut report = compare_views(&model, &file, &dataset.test, self.spp, &bar.mover())?;
        bar.finish_and_clear();
        if let Some(truth) = truth {
            let cells = self.resolution as usize;
            let bar = global.progress("mesh");
            let mesh = mesh_of_run(&model, &file, cells, &bar.mover());
            bar.finish_and_clear();
            report.add_mesh(&mesh, &truth, file.sphere().radius);
        }
        // The images are the background alone, whatever their PSNR is.
        if report.is_empty {
            let run = self.run.display();
            anyhow::bail!("{run}: the run has no surface in a held-out view");
        }
        global.report(&report, || report.table())
    }
}

/// Renders the views with `spp` samples per pixel and compares them with their photographs.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub(super) fn compare_views(
    model: &Model,
    file: &RunFile,
    views: &[View],
    spp: u32,
    progress: &(dyn Fn(f64) + Sync),
) -> anyhow::Result<EvalReport> {
    let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
    let solid = Solid::new(model, file);
    let colors = file.background_of(views);
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let (mut psnrs, mut ssims, mut ious) = (Vec::new(), Vec::new(), Vec::new());
    let mut is_empty = !views.is_empty();
    for (i, view) in views.iter().enumerate() {
        let image = render(&scene, i, spp, file.options.seed, &|p| {
            progress((i as f64 + p) / views.len() as f64)
        })?;
        is_empty &= image.coverage.iter().all(|coverage| *coverage == 0.0);
        psnrs.push(psnr_where(&image.film, &view.image, view.used()));
        ssims.push(ssim(&image.film, &view.image));
        ious.extend(view.coverage().map(|mask| mask_iou(&image.coverage, mask)));
    }
    Ok(EvalReport {
        psnr: mean(&psnrs),
        ssim: mean(&ssims),
        mask_iou: mean(&ious),
        views: views.len(),
        is_empty,
        ..EvalReport::default()
    })
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Number of points sampled on each surface.
const SURFACE_SAMPLES: usize = 100_000;

/// The threshold of the F-score, in bounding radii.
const F_THRESHOLD: f64 = 0.01;

impl EvalReport {
    /// Adds the comparison of a run's mesh with the true surface. `radius` is the bounding radius,
    /// in data set units. A mesh without faces leaves the metrics `None`.
    pub(super) fn add_mesh(&mut self, mesh: &mesh::Mesh, truth: &mesh::Mesh, radius: f64) {
        if mesh.faces.is_empty() {
            return;
        }
        let c = compare(mesh, truth, SURFACE_SAMPLES, F_THRESHOLD * radius);
        self.chamfer = Some(c.chamfer);
        self.chamfer_relative = Some(c.chamfer / radius);
        self.f_score = Some(c.f_score);
        self.normal_consistency = Some(c.normal_consistency);
    }

    /// The report as a table, one metric per line.
    pub(super) fn table(&self) -> String {
        let rows = [
            ("PSNR", self.psnr, "dB"),
            ("SSIM", self.ssim, ""),
            ("mask IoU", self.mask_iou, ""),
            ("Chamfer", self.chamfer, "data set units"),
            ("Chamfer / bounding radius", self.chamfer_relative.map(|c| 100.0 * c), "%"),
            ("F-score at 1 % of the bounding radius", self.f_score, ""),
            ("normal consistency", self.normal_consistency, ""),
        ];
        let line = |(name, value, unit): &(&str, Option<f64>, &str)| {
            let value = value.map_or("-".to_owned(), |v| format!("{v:.4}"));
            format!("{name:<38} {value:>10} {unit}")
        };
        rows.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}
