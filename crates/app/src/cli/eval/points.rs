//! `dsdf eval --points`: DTU's protocol, or the data set's own points.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use super::report::EvalReport;
use crate::cli::common::ARGUMENTS;
use ::mesh::{Mesh, read_points};
use dataset::Dataset;
use field::Sphere;
use files::{InputError, check_memory};
use metrics::{compare_to_cloud, distances_to_surface, points_drawn};

/// The default spacing, in bounding radii. That of NeuS's cameras on DTU is about 165 mm, so this
/// is DTU's 0.2 mm there.
const SPACING: f64 = 1.0 / 800.0;

/// The default cap, in bounding radii: about DTU's 20 mm.
const CAP: f64 = 1.0 / 8.0;

/// Bytes of memory for each point that is drawn.
const MEMORY_PER_POINT: u64 = 192;

/// The options of `--points`.
#[derive(Args, Debug)]
pub(super) struct PointOptions {
    /// Reference points (.ply without faces), in the units of the data set: accuracy, completeness
    /// and their mean as for DTU, and medians. Or `auto`: the data set's own points that at least
    /// four photographs see within 0.7 pixels; mean and median distance to the surface
    #[arg(long, help_heading = "Shape", value_name = "POINTS.ply|auto")]
    pub(super) points: Option<PathBuf>,
    /// Least distance of the points on the reconstruction, in data set units; DTU: 0.2 mm
    /// [default: 1/800 of the bounding radius]
    #[arg(help_heading = "Shape")]
    #[arg(long, value_name = "LENGTH", value_parser = length, requires = "points")]
    point_spacing: Option<f64>,
    /// Larger distances are left out, in data set units; DTU: 20 mm [default: 1/8 of the bounding
    /// radius]
    #[arg(help_heading = "Shape")]
    #[arg(long, value_name = "LENGTH", value_parser = length, requires = "points")]
    point_cap: Option<f64>,
}

/// A length above 0.
fn length(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| (1e-12..=1e12).contains(n));
    number.ok_or_else(|| "expected a length from 1e-12 to 1e12".to_owned())
}

/// The value of `--points` for the points of the data set.
const AUTO: &str = "auto";

/// Points to compare a reconstruction with.
pub(super) enum Reference {
    /// Points of a file, in the units of the data set.
    File(Vec<DVec3>),
    /// The points of the data set.
    Dataset,
}

impl PointOptions {
    /// The reference points; `None` if none are wanted.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn read(&self) -> Result<Option<Reference>, InputError> {
        let read = |path: &PathBuf| match path.as_os_str() == AUTO {
            true if self.point_spacing.is_none() && self.point_cap.is_none() => {
                Ok(Reference::Dataset)
            }
            true => {
                let expected = "a file (.ply) with --point-spacing and --point-cap";
                Err(InputError::new(ARGUMENTS, "--points", AUTO, expected))
            }
            false => read_points(path).map(Reference::File),
        };
        self.points.as_ref().map(read).transpose()
    }

    /// Adds the comparison of a mesh with reference points to a report. The positions of mesh,
    /// `dataset` and `sphere`, the bounding sphere of the run, are relative to the same origin.
    ///
    /// # Errors
    /// If the spacing needs more memory than there is, or the data set has no points.
    pub(super) fn compare(
        &self,
        mesh: &Mesh,
        reference: Reference,
        (dataset, sphere): (&Dataset, &Sphere<f64>),
        report: &mut EvalReport,
    ) -> Result<(), InputError> {
        match reference {
            Reference::File(points) => self.compare_to_file(mesh, points, sphere.radius, report),
            Reference::Dataset => compare_to_dataset(mesh, dataset, sphere, report),
        }
    }

    /// Adds the comparison of a mesh with the points of a file to a report. `radius` is the bounding
    /// radius. A mesh without faces leaves the metrics `None`.
    ///
    /// # Errors
    /// If the spacing needs more memory than there is.
    fn compare_to_file(
        &self,
        mesh: &Mesh,
        mut points: Vec<DVec3>,
        radius: f64,
        report: &mut EvalReport,
    ) -> Result<(), InputError> {
        let spacing = self.point_spacing.unwrap_or(SPACING * radius);
        let count = points_drawn(mesh, spacing);
        let found = format!("{spacing}: {count} points");
        let bytes = (count * MEMORY_PER_POINT as f64) as u64;
        check_memory(ARGUMENTS, "--point-spacing", found, bytes)?;
        points.iter_mut().for_each(|p| *p -= mesh.origin);
        let cap = self.point_cap.unwrap_or(CAP * radius);
        let found = compare_to_cloud(mesh, &points, spacing, cap);
        report.accuracy = found.accuracy.mean;
        report.completeness = found.completeness.mean;
        report.overall = found.overall();
        report.accuracy_median = found.accuracy.median;
        report.completeness_median = found.completeness.median;
        if found.accuracy.points > 0 {
            report.accuracy_beyond_cap = Some(found.accuracy.beyond);
            report.completeness_beyond_cap = Some(found.completeness.beyond);
        }
        Ok(())
    }
}

/// Adds the distances from the sure points of a data set inside the bounding sphere to a mesh.
///
/// # Errors
/// If there are no such points.
fn compare_to_dataset(
    mesh: &Mesh,
    dataset: &Dataset,
    sphere: &Sphere<f64>,
    report: &mut EvalReport,
) -> Result<(), InputError> {
    let is_inside = |x: &DVec3| x.distance(sphere.center) <= sphere.radius;
    let points: Vec<DVec3> = dataset.sure_points().filter(is_inside).collect();
    if points.is_empty() {
        let found =
            format!("{} points, none of them sure and inside the sphere", dataset.points.len());
        let expected =
            "a data set with points that four photographs see (COLMAP), or --points FILE";
        return Err(InputError::new(&dataset.path, "points", found, expected));
    }
    report.points = Some(points.len());
    let found = distances_to_surface(&points, mesh).unwrap_or_default();
    let in_radii = |distance: Option<f64>| distance.map(|distance| distance / sphere.radius);
    report.points_median = in_radii(found.median);
    report.points_mean = in_radii(found.mean);
    Ok(())
}
