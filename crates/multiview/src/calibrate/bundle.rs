//! Bundle adjustment: cameras and points together, from the places where photographs show points.
//!
//! Triggs, McLauchlan, Hartley and Fitzgibbon, "Bundle Adjustment: A Modern Synthesis", 1999:
//! damped Gauss-Newton steps on robust residuals, in which the points are eliminated.

use glam::{DMat3, DVec2, DVec3};
use render::Camera;

use crate::calibrate::calibration::MAX_CORRECTION;
use crate::calibrate::freedom::{OF_LENS, OF_POSE};
use crate::calibrate::median::median;
use crate::calibrate::solve::{Row, System};
use crate::calibrate::units::half_frame;
use crate::calibrate::{Calibration, Freedom};

/// The place of a point in a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// The view.
    pub view: usize,
    /// The place, in pixels of the film of the given camera.
    pub u: DVec2,
}

/// The places of one point in two photographs or more.
pub type Track = Vec<Observation>;

/// The result of an adjustment.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    /// The number of observations whose points are in front of their cameras.
    pub observations: usize,
    /// The median distance of an observation from the image of its point, in pixels; infinite
    /// without an observation.
    pub median: f64,
    /// The same of each view.
    pub of_views: Vec<f64>,
}

/// The input of an adjustment; see [`Calibration::adjust`].
#[derive(Clone, Copy)]
struct Adjustment<'a> {
    tracks: &'a [Track],
    pixel: f64,
    is_free: &'a [bool],
}

/// The residuals, in pixels of the searched photographs, from which on observations lose weight:
/// large at first, so that wrong cameras are not taken for wrong observations.
const SCALES: [f64; 7] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.12, 0.06];

/// Steps with each of them.
const STEPS_PER_SCALE: usize = 10;

/// A step that lowers the cost by less than this share of it is the last with its scale.
const LEAST_FALL: f64 = 1e-5;

/// The damping of the first step, relative to the curvature of each parameter.
const DAMPING: f64 = 1e-4;

/// The largest damping. A step that is still refused is the last.
const MOST_DAMPING: f64 = 1e4;

/// The standard deviation of an observation, in pixels of the searched photographs, which the prior
/// is compared with.
const PLACE: f64 = 0.05;

/// The standard deviation of the prior of a pose: about a degree, and a fiftieth of the distance.
const POSE: f64 = 0.02;

/// The standard deviation of the prior of a lens, as a share of half of the frame.
const LENS: f64 = 0.05;

/// The change of a parameter over which derivatives are taken, in pixels.
const CHANGE: f64 = 1e-4;

impl Calibration {
    /// Moves the free parameters to where the images of points lie on their observations, and
    /// returns the residuals. The points are found on the way. Without a free parameter, the
    /// residuals are those of the best points.
    ///
    /// Observations weigh by Cauchy's function of their residuals, so wrong ones count little. A
    /// weak prior holds the parameters to zero, and those of a view without an observation stay
    /// zero up to the gauge. `pixel` is the size of the pixels in which places were searched, in
    /// pixels of the given cameras: 1 or more. `is_free` has a flag for each view: the poses of the
    /// others stay, and if there are others, so does the gauge.
    ///
    /// # Panics
    /// If a track names a view that is not there, or the number of flags is wrong.
    pub fn adjust(&mut self, tracks: &[Track], pixel: f64, is_free: &[bool]) -> Residuals {
        assert_eq!(is_free.len(), self.given.len(), "a flag for each view");
        let [.., last] = SCALES;
        let adjustment = Adjustment { tracks, pixel, is_free };
        let mut points = self.move_to(&adjustment, &SCALES, None);
        // To hold the gauge moves the cameras by a motion of the world, up to terms of second order
        // in the corrections. A second adjustment is small, so its own are negligible.
        if self.freedom.poses && is_free.iter().all(|is_free| *is_free) {
            let poses = OF_POSE * self.given.len();
            self.gauge.hold(&mut self.parameters[..poses]);
            self.move_to(&adjustment, &[last], Some(self.points_alone(&adjustment)));
            self.gauge.hold(&mut self.parameters[..poses]);
            points = self.points_alone(&adjustment);
        }
        self.residuals(tracks, &points)
    }

    /// The points for the cameras as they are.
    fn points_alone(&self, adjustment: &Adjustment<'_>) -> Vec<Option<DVec3>> {
        Calibration::new(self.cameras(), self.sphere, Freedom::NONE)
            .move_to(adjustment, &SCALES, None)
    }

    /// Moves the free parameters, with one scale after the other, from these points or from those
    /// that are nearest to the rays, and returns the points.
    fn move_to(
        &mut self,
        adjustment: &Adjustment<'_>,
        scales: &[f64],
        points: Option<Vec<Option<DVec3>>>,
    ) -> Vec<Option<DVec3>> {
        let Adjustment { tracks, pixel, .. } = *adjustment;
        let cameras = self.cameras();
        let nearest = || tracks.iter().map(|track| triangulated(track, &cameras)).collect();
        let mut points: Vec<Option<DVec3>> = points.unwrap_or_else(nearest);
        for scale in scales.iter().map(|scale| scale * pixel) {
            let mut damping = DAMPING;
            let mut cost = self.cost(adjustment, &points, scale);
            for _ in 0..STEPS_PER_SCALE {
                let system = self.system(adjustment, &points, scale);
                let before = cost;
                while damping <= MOST_DAMPING {
                    let (step, of_points) = system.step(damping);
                    let mut moved = self.clone();
                    moved.parameters.iter_mut().zip(&step).for_each(|(p, s)| *p += s);
                    let shifted = |(x, s): (&Option<DVec3>, &DVec3)| x.map(|x| x + *s);
                    let next: Vec<_> = points.iter().zip(&of_points).map(shifted).collect();
                    let new = moved.cost(adjustment, &next, scale);
                    if new < cost && moved.parameters.iter().all(|p| p.abs() <= MAX_CORRECTION) {
                        (cost, points, damping) = (new, next, damping * 0.1);
                        *self = moved;
                        break;
                    }
                    damping *= 10.0;
                }
                if before - cost <= LEAST_FALL * before {
                    break;
                }
            }
        }
        points
    }

    fn residuals(&self, tracks: &[Track], points: &[Option<DVec3>]) -> Residuals {
        let cameras = self.cameras();
        let mut of_views = vec![Vec::new(); cameras.len()];
        for (o, x) in observed(tracks, points) {
            if let Some(seen) = cameras[o.view].project(x) {
                of_views[o.view].push((seen - o.u).length());
            }
        }
        let mut all = of_views.concat();
        Residuals {
            observations: all.len(),
            median: median(&mut all),
            of_views: of_views.iter_mut().map(|own| median(own)).collect(),
        }
    }

    /// The robust cost with its prior. Points behind a camera count as if far off.
    fn cost(&self, adjustment: &Adjustment<'_>, points: &[Option<DVec3>], scale: f64) -> f64 {
        let cameras = self.cameras();
        let square = scale * scale;
        let far = 1e4f64;
        let robust = |(o, x): (&Observation, DVec3)| {
            let off = cameras[o.view].project(x).map_or(far, |u| (u - o.u).length().min(far));
            0.5 * square * (off.powi(2) / square).ln_1p()
        };
        let prior =
            self.parameters.iter().zip(self.prior(adjustment.pixel)).map(|(p, w)| 0.5 * w * p * p);
        observed(adjustment.tracks, points).map(robust).sum::<f64>() + prior.sum::<f64>()
    }

    /// The weight of the prior of each parameter, per square pixel, for places that were searched
    /// in pixels of this size.
    fn prior(&self, pixel: f64) -> Vec<f64> {
        let place = PLACE * pixel;
        let pose =
            |camera: &Camera| [(place / (POSE * camera.focal.max_element())).powi(2); OF_POSE];
        let lens = |first: &usize| {
            let camera = &self.given[*first];
            [(place / (LENS * half_frame(camera))).powi(2); OF_LENS]
        };
        let poses = self.given.iter().flat_map(pose);
        poses.chain(self.lenses.iter().flat_map(lens)).collect()
    }

    /// The numbers of the free parameters of a view, each with its cameras before and after. The
    /// pose may be free or not.
    fn around(&self, view: usize, is_free: bool) -> Vec<(usize, [Camera; 2])> {
        let (first, of_lens) = (OF_POSE * view, self.first_of_lens(self.lens_of[view]));
        let (pose, lens) = (self.values(first), self.lens(self.lens_of[view]));
        let pair = |number: usize, change: &dyn Fn(f64) -> Camera| {
            let size = CHANGE * self.units[number];
            (number, [-size, size].map(change))
        };
        let base = &self.given[view];
        let of_pose = (0..if self.freedom.poses && is_free { OF_POSE } else { 0 }).map(|i| {
            pair(first + i, &|size| {
                let mut pose = pose;
                pose[i] += size;
                self.moved(view, base, pose, lens)
            })
        });
        let of_lens = self.freedom.of_lens().map(|i| {
            pair(of_lens + i, &|size| {
                let mut lens = lens;
                lens[i] += size;
                self.moved(view, base, pose, lens)
            })
        });
        of_pose.chain(of_lens).collect()
    }

    /// The linear system of a step.
    fn system(&self, adjustment: &Adjustment<'_>, points: &[Option<DVec3>], scale: f64) -> System {
        let Adjustment { tracks, pixel, is_free } = *adjustment;
        // The free parameters of each view, with its cameras on both sides of a change of each.
        let around: Vec<Vec<(usize, [Camera; 2])>> =
            (0..self.given.len()).map(|view| self.around(view, is_free[view])).collect();
        let cameras = self.cameras();
        let mut rows = Vec::new();
        for (point, (track, x)) in tracks.iter().zip(points).enumerate() {
            let Some(x) = *x else { continue };
            for Observation { view, u } in track {
                let camera = &cameras[*view];
                let Some(seen) = camera.project(x) else { continue };
                let residual = seen - *u;
                // A point moves by about a tenth of a thousandth of a pixel.
                let step = CHANGE * (x - camera.eye).length() * camera.pixel_angle();
                let slope = |a: Option<DVec2>, b: Option<DVec2>, step: f64| {
                    a.zip(b).map_or(DVec2::ZERO, |(a, b)| (b - a) / (2.0 * step))
                };
                let by_point = DVec3::AXES.map(|axis| {
                    let [a, b] = [-step, step].map(|step| camera.project(x + axis * step));
                    slope(a, b, step)
                });
                let by_camera = around[*view]
                    .iter()
                    .map(|(number, [a, b])| (*number, slope(a.project(x), b.project(x), CHANGE)));
                let weight = 1.0 / (1.0 + residual.length_squared() / (scale * scale));
                rows.push(Row {
                    point,
                    residual,
                    weight,
                    by_point,
                    by_camera: by_camera.collect(),
                });
            }
        }
        let priors = self.prior(pixel);
        let pull = priors.iter().zip(&self.parameters).map(|(w, p)| w * p).collect();
        System::new(rows, points.len(), priors, pull)
    }
}

/// The point that is nearest to the rays of a track; `None` if they are nearly parallel.
fn triangulated(track: &Track, cameras: &[Camera]) -> Option<DVec3> {
    let (mut sum, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for Observation { view, u } in track {
        let camera = &cameras[*view];
        let d = camera.direction(*u);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        sum += across;
        right += across * camera.eye;
    }
    // For two rays at the angle a, the determinant is about 2 sin² a.
    (sum.determinant() > 1e-4).then(|| sum.inverse() * right)
}

/// All observations of known points, each with its point.
fn observed<'a>(
    tracks: &'a [Track],
    points: &'a [Option<DVec3>],
) -> impl Iterator<Item = (&'a Observation, DVec3)> {
    let known = tracks.iter().zip(points).filter_map(|(track, x)| Some((track, (*x)?)));
    known.flat_map(|(track, x)| track.iter().map(move |o| (o, x)))
}

#[cfg(test)]
#[path = "bundle_tests.rs"]
mod tests;
