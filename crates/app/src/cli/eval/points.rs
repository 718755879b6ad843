//! `dsdf eval --points`: DTU's protocol.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use super::report::EvalReport;
use crate::cli::common::ARGUMENTS;
use ::mesh::{Mesh, read_points};
use files::{InputError, check_memory};
use metrics::{compare_to_cloud, points_drawn};

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
    /// and their mean as for DTU, and medians
    #[arg(long, help_heading = "Shape")]
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

impl PointOptions {
    /// The reference points, in the units of the data set.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn read(&self) -> Result<Option<Vec<DVec3>>, InputError> {
        self.points.as_deref().map(read_points).transpose()
    }

    /// Adds the comparison of a mesh with these points to a report. `radius` is the bounding
    /// radius. A mesh without faces leaves the metrics `None`.
    ///
    /// # Errors
    /// If the spacing needs more memory than there is.
    pub(super) fn compare(
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
