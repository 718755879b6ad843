//! The errors of a run in each held-out view, and pictures of them.

use std::path::{Path, PathBuf};

use anyhow::Context;

use super::report::{EvalReport, ViewErrors};
use dataset::View;
use film::Film;
use fit::{Model, RunFile, Solid};
use metrics::{mask_iou, psnr_where, ssim};
use render::comparison;
use render::{Render, render};

/// Renders the views with `spp` samples per pixel and compares them with their photographs.
///
/// With a folder for `pictures`, each view gets one: the photograph, the rendered image, its
/// normals and the error.
///
/// # Errors
/// If the field gives a NaN or an infinity, or a picture cannot be written.
pub(in crate::cli) fn compare_views(
    model: &Model,
    file: &RunFile,
    views: &[View],
    spp: u32,
    pictures: Option<&Path>,
    progress: &(dyn Fn(f64) + Sync),
) -> anyhow::Result<EvalReport> {
    let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
    let solid = Solid::new(model, file);
    let colors = file.background_of(views);
    let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
    let mut report = EvalReport { views: views.len(), ..EvalReport::default() };
    let mut is_empty = !views.is_empty();
    for (i, view) in views.iter().enumerate() {
        let image = render(&scene, i, spp, file.options.seed, &|p| {
            progress((i as f64 + p) / views.len() as f64)
        })?;
        is_empty &= image.coverage.iter().all(|coverage| *coverage == 0.0);
        report.per_view.push(ViewErrors {
            name: view.name.clone(),
            psnr: psnr_where(&image.film, &view.image, view.used()),
            psnr_masked: psnr_inside_mask(&image.film, view),
            ssim: Some(ssim(&image.film, &view.image)).filter(|ssim| ssim.is_finite()),
            mask_iou: view.coverage().map(|mask| mask_iou(&image.coverage, mask)),
        });
        if let Some(folder) = pictures {
            write_picture(&picture_path(folder, i, view), &image, view)?;
        }
    }
    let mean = |of: &dyn Fn(&ViewErrors) -> Option<f64>| {
        let values: Vec<f64> = report.per_view.iter().filter_map(of).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    Ok(EvalReport {
        psnr: mean(&|v| v.psnr),
        psnr_masked: mean(&|v| v.psnr_masked),
        ssim: mean(&|v| v.ssim),
        mask_iou: mean(&|v| v.mask_iou),
        is_empty,
        ..report
    })
}

/// The PSNR over the pixels that the object covers by a half or more.
fn psnr_inside_mask(image: &Film, view: &View) -> Option<f64> {
    let inside = view.coverage()?.iter().map(|coverage| *coverage >= 0.5);
    psnr_where(image, &view.image, inside)
}

/// The picture of view number `number`: the number, and the name of the photograph's file.
fn picture_path(folder: &Path, number: usize, view: &View) -> PathBuf {
    let stem = view.path.file_stem().unwrap_or_default().to_string_lossy();
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let stem: String = stem.chars().take(80).map(plain).collect();
    folder.join(format!("{number:03}-{stem}.png"))
}

/// Writes the picture of a view.
fn write_picture(path: &Path, render: &Render, view: &View) -> anyhow::Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot create {}", folder.display()))?;
    Ok(film::write_image(path, &comparison(&view.image, render))?)
}
