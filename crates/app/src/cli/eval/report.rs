//! The errors of a run, in numbers and as tables.

use export::cut::CutReport;
use mesh::Mesh;
use metrics::{Normals, compare};
use serde::Serialize;

/// The errors of a run. A metric is `None` if the data set or the command line has no reference for
/// it.
#[derive(Clone, Debug, Default, Serialize)]
pub(in crate::cli) struct EvalReport {
    /// PSNR in dB, mean over the held-out views.
    pub(in crate::cli) psnr: Option<f64>,
    /// PSNR in dB inside the object's masks, mean over the held-out views that have one.
    pub(super) psnr_masked: Option<f64>,
    /// Structural similarity, mean over the held-out views, with the pixels that masks leave out.
    pub(super) ssim: Option<f64>,
    /// Intersection over union of the masks, mean over the held-out views that have one.
    pub(super) mask_iou: Option<f64>,
    /// Chamfer distance to the true surface: the mean of both directions, in data set units.
    pub(super) chamfer: Option<f64>,
    /// Chamfer distance as a fraction of the data set's bounding radius.
    pub(super) chamfer_relative: Option<f64>,
    /// F-score at [`F_THRESHOLD`].
    pub(super) f_score: Option<f64>,
    /// Mean |n·n′| of the normals of nearest points.
    pub(super) normal_consistency: Option<f64>,
    /// Mean angle between the normals of nearest points, in degrees.
    pub(super) normal_error: Option<f64>,
    /// Like `normal_error`, the median.
    pub(super) normal_error_median: Option<f64>,
    /// Which normals of the true surface are compared: `vertices`, `smoothed` or `faces`.
    pub(super) normals: Option<&'static str>,
    /// Mean distance from points of the reconstruction to the reference points, up to the cap.
    pub(super) accuracy: Option<f64>,
    /// Mean distance from the reference points to points of the reconstruction, up to the cap.
    pub(super) completeness: Option<f64>,
    /// The mean of accuracy and completeness.
    pub(super) overall: Option<f64>,
    /// Like `accuracy`, the median.
    pub(super) accuracy_median: Option<f64>,
    /// Like `completeness`, the median.
    pub(super) completeness_median: Option<f64>,
    /// The part of the points of the reconstruction beyond the cap, 0 to 1.
    pub(super) accuracy_beyond_cap: Option<f64>,
    /// The part of the reference points beyond the cap, 0 to 1.
    pub(super) completeness_beyond_cap: Option<f64>,
    /// The number of points of the data set that were compared, of `--points auto`.
    pub(super) points: Option<usize>,
    /// The median distance from these points to the surface, in bounding radii.
    pub(super) points_median: Option<f64>,
    /// The mean of these distances, in bounding radii.
    pub(super) points_mean: Option<f64>,
    /// Number of held-out views.
    pub(super) views: usize,
    /// The errors of each held-out view.
    pub(super) per_view: Vec<ViewErrors>,
    /// The parts that `--cull` removed from the mesh of the run.
    pub(super) cut: Vec<CutReport>,
    /// Whether there are held-out views, and none shows a surface.
    #[serde(skip)]
    pub(super) is_empty: bool,
}

/// The errors of one held-out view.
#[derive(Clone, Debug, Serialize)]
pub(in crate::cli) struct ViewErrors {
    /// The name of the photograph in the data set.
    pub(super) name: String,
    /// PSNR in dB, over the used pixels of the frame; `None` if a mask leaves all of them out.
    pub(super) psnr: Option<f64>,
    /// PSNR in dB, inside the object's mask; `None` without a mask, or with an empty one.
    pub(super) psnr_masked: Option<f64>,
    /// Structural similarity over the frame; `None` if it is smaller than a window of 11 pixels.
    pub(super) ssim: Option<f64>,
    /// Intersection over union of the masks; `None` without a mask.
    pub(super) mask_iou: Option<f64>,
}

/// Number of points sampled on each surface.
const SURFACE_SAMPLES: usize = 100_000;

/// The threshold of the F-score, in bounding radii.
const F_THRESHOLD: f64 = 0.01;

impl EvalReport {
    /// Adds the comparison of a run's mesh with the true surface. `radius` is the bounding radius,
    /// in data set units. A mesh without faces leaves the metrics `None`.
    pub(in crate::cli) fn add_mesh(&mut self, mesh: &Mesh, truth: &Mesh, radius: f64) {
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
        self.normals = Some(match c.normals {
            Normals::OfVertices => "vertices",
            Normals::Smoothed => "smoothed",
            Normals::OfFaces => "faces",
        });
    }

    /// The report as a table, one metric per line.
    pub(in crate::cli) fn table(&self) -> String {
        let units = "data set units";
        let degrees = match self.normals {
            Some("vertices") => "degrees, to normals of the truth's vertices",
            Some("smoothed") => "degrees, to normals of the truth, smoothed up to 30°",
            _ => "degrees, to normals of the truth's faces",
        };
        let percent = |value: Option<f64>| value.map(|part| 100.0 * part);
        let rows = [
            ("PSNR", self.psnr, "dB"),
            ("PSNR in the masks", self.psnr_masked, "dB"),
            ("SSIM", self.ssim, ""),
            ("mask IoU", self.mask_iou, ""),
            ("Chamfer", self.chamfer, units),
            ("Chamfer / bounding radius", percent(self.chamfer_relative), "%"),
            ("F-score at 1 % of the bounding radius", self.f_score, ""),
            ("normal consistency", self.normal_consistency, ""),
            ("normal error", self.normal_error, degrees),
            ("normal error, median", self.normal_error_median, degrees),
        ];
        let of_points = [
            ("accuracy, to points", self.accuracy, units),
            ("accuracy, median", self.accuracy_median, units),
            ("accuracy, beyond the cap", percent(self.accuracy_beyond_cap), "%"),
            ("completeness, from points", self.completeness, units),
            ("completeness, median", self.completeness_median, units),
            ("completeness, beyond the cap", percent(self.completeness_beyond_cap), "%"),
            ("overall", self.overall, units),
        ];
        let of_dataset = [
            (
                "points of the data set, median distance",
                percent(self.points_median),
                "% of the radius",
            ),
            ("points of the data set, mean distance", percent(self.points_mean), "% of the radius"),
        ];
        let is_compared = self.accuracy_beyond_cap.is_some();
        let has_points = self.points.is_some();
        let rows = rows.iter().chain(of_points.iter().filter(|_| is_compared));
        let rows = rows.chain(of_dataset.iter().filter(|_| has_points));
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

/// The errors as a table, one view a line.
pub(super) fn table(views: &[ViewErrors]) -> String {
    let mut lines = vec![format!(
        "\n{:<32} {:>9} {:>9} {:>9} {:>9}",
        "held-out view", "PSNR", "in mask", "SSIM", "mask IoU"
    )];
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.4}"));
    for v in views {
        let [psnr, masked, ssim, iou] = [v.psnr, v.psnr_masked, v.ssim, v.mask_iou].map(number);
        lines.push(format!("{:<32} {psnr:>9} {masked:>9} {ssim:>9} {iou:>9}", v.name));
    }
    lines.join("\n")
}
