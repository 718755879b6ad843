//! The growth of a bounding sphere that cuts the object off.
//!
//! Where neither points nor outlines show the object, cameras and matches between photographs
//! place the sphere, and it can be too small. A surface that ends on the sphere above the table, in
//! view of a photograph, shows this early: the fit then begins again in a larger sphere.

use std::fs;
use std::path::Path;
use std::time::Instant;

use field::Sphere;
use files::WriteError;
use fit::{Budget, Clock, Fit as Fitting, RunFolder, Session, Solid};
use inspect::radius_clear_of_cameras;
use render::Camera;
use report::surface_shares;

use super::prepare_run::write_run_file;
use crate::cli::common::Global;

/// The progress at which the surface is examined. docs/captures-compared.md has its shares there.
const EXAMINED_AT: f64 = 0.3;

/// The share of the surface's area that must end on the sphere, above the table and in view.
const MOST_CUT_OFF: f64 = 0.09;

/// The factor on the radius.
const GROWTH: f64 = 1.4;

/// The least factor that is worth a new start, where cameras are near.
const LEAST_GROWTH: f64 = 1.1;

/// The progress from which on it is too late: a resumed run can have a shorter budget.
const TOO_LATE: f64 = 0.5;

/// The least share of a time that must be left.
const LEAST_LEFT: f64 = 0.4;

/// Whether the sphere of a fit is to be examined now.
pub(super) fn is_due(fitting: &Fitting) -> bool {
    fitting.file.sphere_growths > 0 && (EXAMINED_AT..TOO_LATE).contains(&fitting.progress())
}

/// Examines the sphere of a fit. If it cuts the object off, the fit begins again in a larger one,
/// with the time that is left, or with all of its iterations.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray, the photographs cannot be read again, or a
/// file of the run cannot be removed or written.
pub(super) fn examine(session: &mut Session, run: &Path, global: &Global) -> anyhow::Result<()> {
    let begin = Instant::now();
    let Some(factor) = larger_sphere(&session.fit)? else {
        session.fit.file.sphere_growths = 0;
        session.fit.clock.seconds += begin.elapsed().as_secs_f64();
        return write_run_file(run, &session.fit.file);
    };
    let before = session.fit.clock.seconds;
    begin_again(session, run, factor, global)?;
    let seconds = before + begin.elapsed().as_secs_f64();
    // As the time of a search for depths, it shortens the schedule, and is no part of it.
    session.fit.clock = Clock { iteration: 0, seconds, searching: seconds };
    remove_results(run)?;
    write_run_file(run, &session.fit.file)?;
    // A run that is killed now continues in the larger sphere.
    Ok(session.save()?)
}

/// Whether a time leaves enough for a new start.
fn has_time(fitting: &Fitting) -> bool {
    match fitting.file.options.budget() {
        Budget::Time(time) => {
            let all = time.as_secs_f64();
            all - fitting.clock.seconds >= LEAST_LEFT * all
        }
        Budget::Iterations(_) => true,
    }
}

/// The factor by which the sphere must grow; `None` if it holds the object, or has no room.
fn larger_sphere(fitting: &Fitting) -> anyhow::Result<Option<f64>> {
    if !has_time(fitting) {
        return Ok(None);
    }
    let Fitting { model, file, photographs, .. } = fitting;
    let dataset = &photographs.dataset;
    let cameras: Vec<Camera> = dataset.train.iter().map(|view| view.camera).collect();
    let (solid, sphere) = (Solid::new(model, file), file.sphere());
    let shares = surface_shares(&solid.scene(&cameras), &sphere, 0..cameras.len())?;
    let is_cut_off = shares.is_some_and(|shares| shares.seen_above_table > MOST_CUT_OFF);
    let room = radius_clear_of_cameras(dataset, sphere.center) / sphere.radius;
    let factor = GROWTH.min(room);
    Ok((is_cut_off && factor >= LEAST_GROWTH).then_some(factor))
}

/// The fit at its first iteration, in a sphere that is larger by this factor.
fn begin_again(
    session: &mut Session,
    run: &Path,
    factor: f64,
    global: &Global,
) -> anyhow::Result<()> {
    let old = &session.fit.file;
    let Sphere { center, radius } = old.world_sphere();
    let sphere = Sphere { center, radius: factor * radius };
    let length = files::length(sphere.radius, sphere.radius);
    global.say(&format!(
        "sphere: what photographs show ends on it, so the fit begins again with a radius of {length}"
    ));
    let dataset = old.read(None)?;
    let file = old.grown(&sphere, &dataset);
    let dataset = file.prepare(dataset);
    *session = Session::new(run, dataset, file, &global.registry, false)?;
    Ok(())
}

/// Removes the files of the smaller sphere: a checkpoint there would continue in the larger one.
fn remove_results(run: &Path) -> anyhow::Result<()> {
    let folder = RunFolder::new(run);
    for path in folder.results().into_iter().chain([folder.checkpoint()]) {
        if path.symlink_metadata().is_ok() {
            fs::remove_file(&path).map_err(|e| WriteError::of_file(&path, e))?;
        }
    }
    Ok(())
}
