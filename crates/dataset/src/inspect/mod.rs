//! What was understood of a data set, in words and in one picture.

mod overlay;
#[cfg(test)]
mod tests;

use std::fmt;

use field::Sphere;
use glam::{DVec2, DVec3};
use serde::Serialize;

pub use overlay::overlay;

use crate::{Background, Dataset, View, looks_away};

/// What was understood of a data set; lengths in its own units.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The format and the convention of the cameras.
    pub format: String,
    /// Views to fit.
    pub train_views: usize,
    /// Held-out views.
    pub test_views: usize,
    /// Views with a mask or an alpha channel.
    pub masks: usize,
    /// Width and height of the first view, pixels.
    pub image_size: [u32; 2],
    /// Focal lengths of the first view, pixels.
    pub focal: [f64; 2],
    /// Horizontal field of view of the first view, degrees.
    pub field_of_view: f64,
    /// Distance of the cameras from the sphere's centre: least, mean, most.
    pub distance: [f64; 3],
    /// The largest angle between two cameras as seen from the centre, degrees.
    pub spread: f64,
    /// The fraction of all directions from the centre that are within 30 degrees of a camera.
    pub surrounded: f64,
    /// Lowest and highest elevation of a camera over the centre, in degrees, with z up.
    pub elevation: [f64; 2],
    /// Views whose optical axis passes through the sphere.
    pub axes_through: usize,
    /// The mean angle between a camera's axis and the direction to the centre, degrees.
    pub off_axis: f64,
    /// Centre of the bounding sphere.
    pub center: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Where the sphere comes from.
    pub bounds_from: String,
    /// The fraction of each view, training views first, that the sphere covers.
    pub coverage: Vec<f64>,
    /// The background, linear RGB.
    pub background: [f32; 3],
    /// Its standard deviation in display space, 0 to 1.
    pub background_spread: f32,
    /// How uniform the background is, 0 to 1.
    pub background_confidence: f32,
    /// What looks wrong.
    pub warnings: Vec<String>,
}

/// A camera that looks this far past the centre, in degrees, beyond its own field of view, is
/// suspicious.
const OFF_AXIS: f64 = 45.0;

/// Describes a data set with the bounding sphere and background that a fit would use.
pub fn inspect(
    dataset: &Dataset,
    bounds: &Sphere<f64>,
    background: &Background,
    bounds_from: &str,
) -> Report {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let to_center: Vec<DVec3> = views.iter().map(|v| bounds.center - v.camera.eye).collect();
    let distances: Vec<f64> = to_center.iter().map(|d| d.length()).collect();
    let angle = |a: DVec3, b: DVec3| a.angle_between(b).to_degrees();
    let off: Vec<f64> =
        views.iter().zip(&to_center).map(|(v, d)| angle(v.camera.forward, *d)).collect();
    let spread = (0..views.len())
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| angle(to_center[i], to_center[j]))
        .fold(0.0, f64::max);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let coverage: Vec<f64> = views.iter().map(|v| coverage(v, bounds)).collect();
    let first = &views[0].camera;
    let mut report = Report {
        format: dataset.format.clone(),
        train_views: dataset.train.len(),
        test_views: dataset.test.len(),
        masks: views.iter().filter(|v| v.mask.is_some()).count(),
        image_size: [first.width, first.height],
        focal: first.focal.to_array(),
        field_of_view: 2.0 * (0.5 * f64::from(first.width) / first.focal.x).atan().to_degrees(),
        distance: [
            distances.iter().copied().fold(f64::INFINITY, f64::min),
            mean(&distances),
            distances.iter().copied().fold(0.0, f64::max),
        ],
        spread,
        surrounded: surrounded(&to_center),
        elevation: elevation(&to_center),
        axes_through: views.iter().filter(|v| passes_through(v, bounds)).count(),
        off_axis: mean(&off),
        center: bounds.center.to_array(),
        radius: bounds.radius,
        bounds_from: bounds_from.to_owned(),
        coverage,
        background: background.color,
        background_spread: background.spread,
        background_confidence: background.confidence,
        warnings: Vec::new(),
    };
    report.warn(&views, bounds, &off);
    report
}

/// True if a view's optical axis meets the sphere in front of it.
fn passes_through(view: &View, bounds: &Sphere<f64>) -> bool {
    !looks_away(view, bounds) && bounds.clip(view.camera.eye, view.camera.forward).is_some()
}

/// The fraction of all directions that are within 30 degrees of the way to a camera.
fn surrounded(to_center: &[DVec3]) -> f64 {
    const DIRECTIONS: usize = 2000;
    let near = 30f64.to_radians().cos();
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let covered = (0..DIRECTIONS).filter(|&i| {
        // A Fibonacci lattice: points spread evenly over the sphere.
        let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
        let (s, c) = (golden * i as f64).sin_cos();
        let direction = DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z;
        to_center.iter().any(|d| -d.normalize_or_zero().dot(direction) > near)
    });
    covered.count() as f64 / DIRECTIONS as f64
}

/// Lowest and highest elevation of the cameras over the centre, in degrees.
fn elevation(to_center: &[DVec3]) -> [f64; 2] {
    let each =
        to_center.iter().map(|d| (-d.normalize_or_zero().z).clamp(-1.0, 1.0).asin().to_degrees());
    each.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], e| [low.min(e), high.max(e)])
}

/// The fraction of a view's pixels whose rays meet the sphere, from a grid of at most 64 × 64.
fn coverage(view: &View, bounds: &Sphere<f64>) -> f64 {
    const GRID: u32 = 64;
    let size = DVec2::new(f64::from(view.camera.width), f64::from(view.camera.height));
    let inside = (0..GRID * GRID).filter(|i| {
        let u = DVec2::new(f64::from(i % GRID) + 0.5, f64::from(i / GRID) + 0.5) / f64::from(GRID)
            * size;
        bounds.clip(view.camera.eye, view.camera.direction(u)).is_some()
    });
    inside.count() as f64 / f64::from(GRID * GRID)
}

impl Report {
    fn warn(&mut self, views: &[&View], bounds: &Sphere<f64>, off: &[f64]) {
        let away = views.iter().filter(|v| looks_away(v, bounds)).count();
        let past = off.iter().filter(|a| **a > OFF_AXIS).count();
        let mut warn = |text: String| self.warnings.push(text);
        if 2 * away > off.len() {
            warn(format!(
                "{away} of {} cameras look away from the centre: the poses may be in the OpenCV convention, or world-to-camera",
                off.len()
            ));
        } else if past > 0 {
            warn(format!(
                "{past} of {} cameras look more than {OFF_AXIS} degrees past the centre",
                off.len()
            ));
        }
        if self.distance[0] <= self.radius {
            warn("a camera is inside the bounding sphere (see --bounds)".to_owned());
        }
        let size = |v: &View| [v.camera.width, v.camera.height];
        let other = views.iter().filter(|v| size(v) != self.image_size).count();
        if other > 0 {
            warn(format!("{other} images are of another size than the first"));
        }
        let unseen = self.coverage.iter().filter(|c| **c == 0.0).count();
        if unseen > 0 {
            warn(format!("{unseen} views do not see the bounding sphere at all"));
        }
        if self.train_views < 3 {
            warn("fewer than three views to fit".to_owned());
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [near, mean, far] = self.distance;
        let [x, y, z] = self.center;
        let [width, height] = self.image_size;
        let least = self.coverage.iter().copied().fold(1.0, f64::min);
        let most = self.coverage.iter().copied().fold(0.0, f64::max);
        writeln!(f, "format       {}", self.format)?;
        writeln!(
            f,
            "views        {} to fit, {} held out, {} with masks",
            self.train_views, self.test_views, self.masks
        )?;
        let [fx, fy] = self.focal;
        let across = self.field_of_view;
        writeln!(
            f,
            "images       {width} x {height} pixels, {across:.1} degrees across (focal {fx:.1}, {fy:.1} pixels)"
        )?;
        writeln!(
            f,
            "cameras      {near:.4} to {far:.4} from the centre (mean {mean:.4}), up to {:.0} degrees apart",
            self.spread
        )?;
        let [low, high] = self.elevation;
        let around = 100.0 * self.surrounded;
        writeln!(
            f,
            "             {low:.0} to {high:.0} degrees above the centre (z up), within 30 degrees of {around:.0} % of all directions"
        )?;
        let (through, all) = (self.axes_through, self.train_views + self.test_views);
        writeln!(
            f,
            "             {through} of {all} axes pass through the sphere, {:.1} degrees off its centre on average",
            self.off_axis
        )?;
        writeln!(
            f,
            "sphere       centre ({x:.4}, {y:.4}, {z:.4}), radius {:.4}, {}",
            self.radius, self.bounds_from
        )?;
        writeln!(
            f,
            "coverage     the sphere covers {:.0} to {:.0} % of each image",
            100.0 * least,
            100.0 * most
        )?;
        let (spread, confidence) = (self.background_spread, self.background_confidence);
        write!(
            f,
            "background   linear RGB {:.3?}, spread {spread:.3}, confidence {confidence:.2}",
            self.background
        )?;
        for warning in &self.warnings {
            write!(f, "\nWARNING      {warning}")?;
        }
        Ok(())
    }
}
