//! `dsdf eval`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::{Global, mover};
use dataset::{LoadOptions, View};
use fit::{Model, RunFile, scene};
use mesh::{extract, read_mesh};
use metrics::{compare, mask_iou, psnr, ssim};
use render::render;

/// Measure a run on held-out views, and against a mesh.
#[derive(Args, Debug)]
pub(crate) struct Eval {
    /// The run folder
    run: PathBuf,
    /// The data set [default: the one of the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// The true surface, .ply or .obj, in the data set's units
    #[arg(long)]
    mesh: Option<PathBuf>,
    /// Samples a pixel
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    spp: u32,
    /// Grid cells along the diameter for the run's own mesh
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=2048))]
    resolution: u32,
}

/// What was measured; `null` where there is nothing to compare with.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Report {
    pub(super) psnr: Option<f64>,
    pub(super) ssim: Option<f64>,
    pub(super) mask_iou: Option<f64>,
    pub(super) chamfer: Option<f64>,
    pub(super) chamfer_relative: Option<f64>,
    pub(super) f_score: Option<f64>,
    pub(super) normal_consistency: Option<f64>,
    pub(super) views: usize,
}

impl Eval {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let file = RunFile::load(&self.run)?;
        let model = Model::load(&self.run)?;
        let truth = self.mesh.as_deref().map(read_mesh).transpose()?;
        let path = self.dataset.as_deref().unwrap_or(&file.dataset);
        let dataset = dataset::load(path, &LoadOptions { downscale: file.options.downscale })?;
        let bar = global.progress("eval");
        let mut report = views(&model, &file, &dataset.test, self.spp, &mover(&bar))?;
        if let Some(truth) = truth {
            let mesh =
                extract(&model.field, &file.sphere(), self.resolution as usize, &mover(&bar));
            report.add_mesh(&mesh, &truth, file.sphere().radius);
        }
        bar.finish_and_clear();
        global.report(&report, || report.table())
    }
}

/// Image metrics, each the mean over the views.
pub(super) fn views(
    model: &Model,
    file: &RunFile,
    views: &[View],
    spp: u32,
    progress: &(dyn Fn(f64) + Sync),
) -> anyhow::Result<Report> {
    let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
    let scene = scene(model, file, &cameras);
    let (mut psnrs, mut ssims, mut ious) = (Vec::new(), Vec::new(), Vec::new());
    for (i, view) in views.iter().enumerate() {
        let image = render(&scene, i, spp, file.options.seed, &|p| {
            progress((i as f64 + p) / views.len() as f64)
        })?;
        psnrs.push(psnr(&image.film, &view.image));
        ssims.push(ssim(&image.film, &view.image));
        ious.extend(view.mask.as_ref().map(|mask| mask_iou(&image.coverage, mask)));
    }
    Ok(Report {
        psnr: mean(&psnrs),
        ssim: mean(&ssims),
        mask_iou: mean(&ious),
        views: views.len(),
        ..Report::default()
    })
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Points sampled on each surface.
const SURFACE_SAMPLES: usize = 100_000;

/// The F-score's threshold, as a fraction of the bounding radius.
const F_THRESHOLD: f64 = 0.01;

impl Report {
    /// Adds the comparison with the true surface; an empty mesh compares with nothing.
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

    /// The report as lines.
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
