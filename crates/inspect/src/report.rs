//! A report on a loaded data set, as numbers.

use field::{Sphere, fibonacci_direction};
use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::{BackgroundEstimate, looks_away};
use dataset::{Dataset, Distortion, MaskKind, View};

use crate::exposure::{Exposure, ExposureSource, MOST_SPREAD, exposure_spread};
use crate::still::Still;

/// A report on a data set; lengths in its own units.
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
    /// Width and height in pixels, and the number of views, of each size: that of the first view
    /// first.
    pub image_sizes: Vec<([u32; 2], usize)>,
    /// The distortion that was removed from the photographs; `None` if it is not known.
    /// [`inspect`] sees no photograph as it was, so its caller adds this.
    pub distortion: Option<Distortion>,
    /// Focal lengths (x, y) of the first view, pixels.
    pub focal: [f64; 2],
    /// Horizontal field of view of the first view, degrees.
    pub field_of_view: f64,
    /// Distance of the cameras from the sphere's centre: least, mean, largest.
    pub distance: [f64; 3],
    /// The largest angle between two cameras as seen from the centre, degrees.
    pub spread: f64,
    /// The fraction of all directions from the centre that are within 30 degrees of a camera.
    pub surrounded: f64,
    /// Lowest and highest elevation of a camera above the centre, degrees, with z up.
    pub elevation: [f64; 2],
    /// Views whose optical axis passes through the sphere.
    pub axes_through: usize,
    /// The mean angle between a camera's axis and the direction to the centre, degrees.
    pub off_axis: f64,
    /// Centre of the bounding sphere.
    pub center: [f64; 3],
    /// Radius of the bounding sphere.
    pub radius: f64,
    /// The origin of the bounding sphere, as text.
    pub bounds_from: String,
    /// The fraction of each view that the sphere covers, training views first.
    pub coverage: Vec<f64>,
    /// The background, linear RGB.
    pub background: [f32; 3],
    /// The background's standard deviation in display space, 0 to 1.
    pub background_spread: f32,
    /// How uniform the background is, 0 to 1.
    pub background_confidence: f32,
    /// The share of the pixels around the sphere, 0 to 1, that stand still in the image while the
    /// cameras move: see [`Still`]. 0 in front of a uniform background.
    pub backdrop_still: f32,
    /// The spread of the exposures of the training views; `None` if they do not show it.
    pub exposure: Option<Exposure>,
    /// The notes of the data set ([`Dataset::notes`]), and one sentence for each suspicious
    /// property.
    pub warnings: Vec<String>,
}

impl Report {
    /// Whether the backdrop stands still in the image while the cameras move: an object that turns
    /// in front of a fixed camera.
    pub fn is_backdrop_still(&self) -> bool {
        Still { share: self.backdrop_still, ..Still::NONE }.is_still()
    }
}

/// The angle between an optical axis and the direction to the centre above which a warning is
/// given, degrees.
const OFF_AXIS: f64 = 45.0;

/// The radius of the cap of directions that one camera covers, degrees.
const CAP: f64 = 30.0;

/// Directions by which the covered fraction of the sphere is counted.
const DIRECTIONS: usize = 2000;

/// Rays along each side of a view by which the sphere's coverage is counted.
const COVERAGE_RAYS: u32 = 64;

/// Describes a data set with the bounding sphere and the background of a fit. `bounds_from` is the
/// origin of the sphere, as text.
///
/// # Panics
/// If the data set has no views.
pub fn inspect(
    dataset: &Dataset,
    bounds: &Sphere<f64>,
    background: &BackgroundEstimate,
    bounds_from: &str,
) -> Report {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let to_center: Vec<DVec3> = views.iter().map(|v| bounds.center - v.camera.eye).collect();
    let off_axis: Vec<f64> =
        views.iter().zip(&to_center).map(|(v, d)| angle(v.camera.forward, *d)).collect();
    let first = &views[0].camera;
    let still = match background.is_uniform() {
        true => Still::NONE,
        false => Still::of(&dataset.train, bounds),
    };
    let mut report = Report {
        format: dataset.format.clone(),
        train_views: dataset.train.len(),
        test_views: dataset.test.len(),
        masks: views.iter().filter(|v| v.mask.is_some()).count(),
        image_size: [first.width, first.height],
        image_sizes: sizes(&views),
        distortion: None,
        focal: first.focal.to_array(),
        field_of_view: 2.0 * (0.5 * f64::from(first.width) / first.focal.x).atan().to_degrees(),
        distance: distance(&to_center),
        spread: largest_angle(&to_center),
        surrounded: surrounded(&to_center),
        elevation: elevation(&to_center),
        axes_through: views.iter().filter(|v| passes_through(v, bounds)).count(),
        off_axis: mean(&off_axis),
        center: bounds.center.to_array(),
        radius: bounds.radius,
        bounds_from: bounds_from.to_owned(),
        coverage: views.iter().map(|v| coverage(v, bounds)).collect(),
        background: background.color,
        background_spread: background.spread,
        background_confidence: background.confidence,
        backdrop_still: still.share,
        exposure: match still.is_still() {
            true => Some(Exposure { stops: still.stops(), from: ExposureSource::Background }),
            false => exposure_spread(&dataset.train, bounds, background),
        },
        warnings: Vec::new(),
    };
    report.warnings.clone_from(&dataset.notes);
    report.warnings.extend(warnings(&report, &views, bounds, &off_axis));
    report
}

/// The sizes of views with the number of each, in the order in which they occur.
fn sizes(views: &[&View]) -> Vec<([u32; 2], usize)> {
    let mut sizes: Vec<([u32; 2], usize)> = Vec::new();
    for view in views {
        let size = [view.camera.width, view.camera.height];
        match sizes.iter_mut().find(|(known, _)| *known == size) {
            Some((_, count)) => *count += 1,
            None => sizes.push((size, 1)),
        }
    }
    sizes
}

/// The share of pixels that masks may leave out without a warning.
const MOST_LEFT_OUT: f64 = 0.5;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The angle between two vectors, degrees.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.angle_between(b).to_degrees()
}

/// Least, mean and largest length.
fn distance(to_center: &[DVec3]) -> [f64; 3] {
    let lengths: Vec<f64> = to_center.iter().map(|d| d.length()).collect();
    [
        lengths.iter().copied().fold(f64::INFINITY, f64::min),
        mean(&lengths),
        lengths.iter().copied().fold(0.0, f64::max),
    ]
}

/// The largest angle between two of the vectors, degrees.
fn largest_angle(to_center: &[DVec3]) -> f64 {
    (0..to_center.len())
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| angle(to_center[i], to_center[j]))
        .fold(0.0, f64::max)
}

/// True if a view's optical axis meets the sphere in front of the camera.
fn passes_through(view: &View, bounds: &Sphere<f64>) -> bool {
    !looks_away(view, bounds) && bounds.clip(view.camera.eye, view.camera.forward).is_some()
}

/// The fraction of all directions from the centre that are within [`CAP`] of a camera, counted on a
/// Fibonacci lattice.
fn surrounded(to_center: &[DVec3]) -> f64 {
    let near = CAP.to_radians().cos();
    let covered = (0..DIRECTIONS).filter(|&i| {
        let direction = fibonacci_direction(i, DIRECTIONS, 0.0);
        to_center.iter().any(|d| -d.normalize_or_zero().dot(direction) > near)
    });
    covered.count() as f64 / DIRECTIONS as f64
}

/// Lowest and highest elevation of the cameras above the centre, degrees.
fn elevation(to_center: &[DVec3]) -> [f64; 2] {
    let each =
        to_center.iter().map(|d| (-d.normalize_or_zero().z).clamp(-1.0, 1.0).asin().to_degrees());
    each.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], e| [low.min(e), high.max(e)])
}

/// The fraction of a view's film whose rays meet the sphere, from 64 × 64 rays.
fn coverage(view: &View, bounds: &Sphere<f64>) -> f64 {
    let size = DVec2::new(f64::from(view.camera.width), f64::from(view.camera.height));
    let inside = (0..COVERAGE_RAYS * COVERAGE_RAYS).filter(|i| {
        let (x, y) = (i % COVERAGE_RAYS, i / COVERAGE_RAYS);
        let u =
            DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / f64::from(COVERAGE_RAYS) * size;
        bounds.clip(view.camera.eye, view.camera.direction(u)).is_some()
    });
    inside.count() as f64 / f64::from(COVERAGE_RAYS * COVERAGE_RAYS)
}

/// The suspicious properties of a data set. `off_axis` has an angle a view, degrees.
fn warnings(
    report: &Report,
    views: &[&View],
    bounds: &Sphere<f64>,
    off_axis: &[f64],
) -> Vec<String> {
    let mut warnings = Vec::new();
    let all = views.len();
    let away = views.iter().filter(|v| looks_away(v, bounds)).count();
    let past = off_axis.iter().filter(|a| **a > OFF_AXIS).count();
    if 2 * away > all {
        warnings.push(format!(
            "{away} of {all} cameras look away from the centre: \
             the poses may be in the OpenCV convention, world-to-camera, or mirrored"
        ));
    } else if past > 0 {
        warnings.push(format!(
            "{past} of {all} cameras look more than {OFF_AXIS} degrees past the centre"
        ));
    }
    if report.distance[0] <= report.radius {
        warnings.push("a camera is inside the bounding sphere (see --bounds)".to_owned());
    }
    let other_size = all - report.image_sizes[0].1;
    if other_size > 0 {
        warnings.push(format!("{other_size} images are of another size than the first"));
    }
    let unseen = report.coverage.iter().filter(|c| **c == 0.0).count();
    if unseen > 0 {
        warnings.push(format!("{unseen} views do not see the bounding sphere at all"));
    }
    if let Some(Exposure { stops, .. }) = report.exposure
        && stops > MOST_SPREAD
    {
        warnings.push(format!(
            "the exposures of the photographs differ by {stops:.2} stops (standard deviation): \
             a fit finds one for each, unless --exposure is none"
        ));
    }
    warnings.extend(of_poses(views, bounds));
    warnings.extend(of_masks(&views[..report.train_views], views));
    if report.train_views < 3 {
        warnings.push("fewer than three views to fit".to_owned());
    }
    warnings
}

/// The largest distance between two places that count as one, in parts of the distance from the
/// sphere's centre, and the largest difference between two axes.
const ONE_POSE: f64 = 1e-6;

/// The distance of the principal point from the middle of the image, in parts of its width and
/// height, above which a warning is given.
const OFF_MIDDLE: f64 = 0.15;

/// Views of one pose, and principal points far from the middle of the image.
fn of_poses(views: &[&View], bounds: &Sphere<f64>) -> Vec<String> {
    let mut warnings = Vec::new();
    let is_same = |a: &View, b: &View| {
        let (a, b) = (&a.camera, &b.camera);
        let reach = ONE_POSE * a.eye.distance(bounds.center);
        let turned = a.forward.distance(b.forward).max(a.up.distance(b.up));
        a.eye.distance(b.eye) <= reach && turned <= ONE_POSE
    };
    let doubles: Vec<&&View> = (0..views.len())
        .filter(|&i| (0..views.len()).any(|j| i != j && is_same(views[i], views[j])))
        .map(|i| &views[i])
        .collect();
    if let [first, second, ..] = doubles[..] {
        let (count, all) = (doubles.len(), views.len());
        warnings.push(format!(
            "{count} of {all} views have the pose of another view, {} and {} for example: the poses \
             of photographs from different places may have been lost",
            first.name, second.name
        ));
    }
    let off_middle = |view: &&&View| {
        let camera = &view.camera;
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        (camera.principal / size - 0.5).abs().max_element() > OFF_MIDDLE
    };
    let off: Vec<&&View> = views.iter().filter(off_middle).collect();
    if let Some(first) = off.first() {
        let (count, camera) = (off.len(), &first.camera);
        warnings.push(format!(
            "{count} principal points are far from the middle of their images, that of {} at {:.0}, \
             {:.0} of {} x {} pixels: the camera file may be for images of another size, or the \
             images were cropped",
            first.name, camera.principal.x, camera.principal.y, camera.width, camera.height
        ));
    }
    warnings
}

/// The suspicious properties of the masks. `train` are the views to fit, `views` are all.
fn of_masks(train: &[&View], views: &[&View]) -> Vec<String> {
    let mut warnings = Vec::new();
    let without: Vec<&&View> = train.iter().filter(|v| v.coverage().is_none()).collect();
    if let Some(first) = without.first().filter(|_| without.len() < train.len()) {
        let (count, all, name) = (train.len() - without.len(), train.len(), &first.name);
        warnings.push(format!(
            "only {count} of {all} views to fit have a mask of the object, so none is used; the \
             first without one is {name}"
        ));
    }
    let is_even = |v: &&&View| {
        let is_object = |coverage: &&f32| **coverage >= 0.5;
        v.coverage()
            .is_some_and(|all| [0, all.len()].contains(&all.iter().filter(is_object).count()))
    };
    let even: Vec<&&View> = train.iter().filter(is_even).collect();
    // Photographs with an alpha channel that says nothing are common.
    let is_alpha = |v: &&&View| v.mask.as_ref().is_some_and(|mask| mask.kind == MaskKind::Alpha);
    let says_nothing = even.len() == train.len() && even.iter().all(is_alpha);
    if let Some(first) = even.first().filter(|_| !says_nothing) {
        let (count, all, name) = (even.len(), train.len() - without.len(), &first.name);
        warnings.push(format!(
            "{count} of {all} masks of the object are black or white everywhere; the first is that \
             of {name}. White is the object: the numbers 1 or 2 of 255 count as black"
        ));
    }
    let of_view = |v: &&View| {
        let unused = (0..v.image.pixels.len()).filter(|i| !v.is_used(*i)).count();
        unused as f64 / v.image.pixels.len() as f64
    };
    let left_out = mean(&views.iter().map(of_view).collect::<Vec<f64>>());
    if left_out > MOST_LEFT_OUT {
        let percent = 100.0 * left_out;
        warnings.push(format!("masks leave out {percent:.0} % of the pixels; white is used"));
    }
    warnings
}
