//! Corrections of the cameras of a set of photographs, and their optimiser.

use field::Sphere;
use glam::{DQuat, DVec2, DVec3};
use optim::{Adam, Group, OptimError};
use render::{Camera, CameraAdjoint};
use serde::Serialize;

use crate::calibrate::freedom::{Freedom, OF_LENS, OF_POSE};
use crate::calibrate::gauge::Gauge;
use crate::calibrate::median::median;
use crate::calibrate::units::{of_lens, of_pose};

/// The weight of the prior ½ |correction|², in pixels, per view: a thousandth of the slope of the
/// loss of a textured photograph that is one pixel off. It holds a view without texture in place.
const PRIOR: f64 = 1e-5;

/// The largest correction of one parameter, in pixels: what is farther off is no correction.
pub(crate) const MAX_CORRECTION: f64 = 1000.0;

/// The reason why a state or a step was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The optimiser refused it.
    #[error(transparent)]
    Optimiser(#[from] OptimError),
    /// The number of saved parameters is not that of the cameras.
    #[error("{found} parameters of cameras, expected {expected}")]
    Count {
        /// The number of saved parameters.
        found: usize,
        /// The number of parameters of these cameras.
        expected: usize,
    },
}

/// The correction of a view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Correction {
    /// The angle of the rotation, in degrees.
    pub degrees: f64,
    /// The shift of the eye, in world units.
    pub shift: [f64; 3],
    /// The motion of the image of the bounding sphere's centre, in pixels.
    pub pixels: f64,
}

/// Corrections of cameras: a rotation and a shift of each view, and a focal length, a principal
/// point and a distortion of each lens. Views with equal intrinsics share a lens.
///
/// All parameters are in pixels: a change by 1 moves an image by about one pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    pub(crate) given: Vec<Camera>,
    pub(crate) sphere: Sphere<f64>,
    pub(crate) freedom: Freedom,
    /// The lens of each view.
    pub(crate) lens_of: Vec<usize>,
    /// The first view of each lens.
    pub(crate) lenses: Vec<usize>,
    /// The poses of all views, then the lenses, in pixels.
    pub(crate) parameters: Vec<f64>,
    /// World units, radians, … per pixel.
    pub(crate) units: Vec<f64>,
    pub(crate) gauge: Gauge,
    adam: Adam<f64>,
}

impl Calibration {
    /// The calibration of `given` cameras around the bounding sphere, with corrections of zero.
    pub fn new(given: Vec<Camera>, sphere: Sphere<f64>, freedom: Freedom) -> Self {
        let (mut lenses, mut lens_of) = (Vec::<usize>::new(), Vec::new());
        for (view, camera) in given.iter().enumerate() {
            let known = lenses.iter().position(|first| given[*first].has_lens_of(camera));
            lens_of.push(known.unwrap_or(lenses.len()));
            if known.is_none() {
                lenses.push(view);
            }
        }
        let mut units: Vec<f64> = given.iter().flat_map(|c| of_pose(c, &sphere)).collect();
        units.extend(lenses.iter().flat_map(|first| of_lens(&given[*first])));
        let gauge = Gauge::new(&given, &sphere);
        let count = units.len();
        let adam = Adam::new(count, vec![Group::new("cameras", 0..count)]);
        let parameters = vec![0.0; count];
        Calibration { given, sphere, freedom, lens_of, lenses, parameters, units, gauge, adam }
    }

    /// The calibration without a gauge, for cameras that look at a world that is known.
    #[must_use]
    pub fn without_gauge(self) -> Self {
        Calibration { gauge: Gauge::default(), ..self }
    }

    /// The corrected form of `base`, the camera of a view at some size.
    pub fn apply(&self, view: usize, base: &Camera) -> Camera {
        let pose = self.values(OF_POSE * view);
        self.moved(view, base, pose, self.lens(self.lens_of[view]))
    }

    /// The form of `base`, the camera of a view at some size, with these corrections of the pose
    /// and the lens, in their own units.
    pub(crate) fn moved(
        &self,
        view: usize,
        base: &Camera,
        [a, b, c, shift @ ..]: [f64; OF_POSE],
        [log_focal, x, y, k1, k2]: [f64; OF_LENS],
    ) -> Camera {
        let turn = DQuat::from_scaled_axis(DVec3::new(a, b, c));
        let [right, up, forward] = [base.right, base.up, base.forward].map(|v| turn * v);
        Camera {
            right,
            up,
            forward,
            eye: base.eye + DVec3::from(shift),
            focal: base.focal * log_focal.exp(),
            principal: base.principal + DVec2::new(x, y) * self.scale(view, base),
            radial: base.radial + DVec2::new(k1, k2),
            ..*base
        }
    }

    /// The corrected cameras of all views, at the sizes at which they were given.
    pub fn cameras(&self) -> Vec<Camera> {
        self.given.iter().enumerate().map(|(view, camera)| self.apply(view, camera)).collect()
    }

    /// The correction of the lens of a view that was not given, for held-out photographs: that of
    /// the lens with the same intrinsics, or of the only lens. Other lenses stay as they are.
    pub fn apply_lens(&self, base: &Camera) -> Camera {
        let same = |first: &usize| self.given[*first].has_lens_of(base);
        let only = (self.lenses.len() == 1).then_some(0);
        let Some(lens) = self.lenses.iter().position(same).or(only) else { return *base };
        let [log_focal, x, y, k1, k2] = self.lens(lens);
        Camera {
            focal: base.focal * log_focal.exp(),
            principal: base.principal + DVec2::new(x, y) * self.scale(self.lenses[lens], base),
            radial: base.radial + DVec2::new(k1, k2),
            ..*base
        }
    }

    /// One step of the optimiser against the adjoints of all views. `bases` are the cameras of the
    /// views at the size of the adjoints, without corrections; `rate` is in pixels.
    ///
    /// # Errors
    /// If an adjoint is not finite. Nothing has changed then.
    pub fn step(
        &mut self,
        bases: &[Camera],
        adjoints: &[CameraAdjoint],
        rate: f64,
    ) -> Result<(), CalibrationError> {
        let gradient = self.gradient(bases, adjoints);
        self.adam.step(&mut self.parameters, &gradient, rate)?;
        if self.freedom.poses {
            self.gauge.hold(&mut self.parameters[..OF_POSE * self.given.len()]);
        }
        self.parameters.iter_mut().for_each(|v| *v = v.clamp(-MAX_CORRECTION, MAX_CORRECTION));
        Ok(())
    }

    /// The gradient by the parameters, in pixels, with the prior.
    pub(crate) fn gradient(&self, bases: &[Camera], adjoints: &[CameraAdjoint]) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameters.len()];
        let prior = PRIOR / self.given.len() as f64;
        for (view, (base, adjoint)) in bases.iter().zip(adjoints).enumerate() {
            if self.freedom.poses {
                let (turn, _) = self.pose(view);
                let turn = rotation_vjp(turn, adjoint.rotation);
                let own = [turn, adjoint.eye].map(|v| v.to_array()).concat();
                self.add(&mut gradient, OF_POSE * view, own.into_iter().enumerate());
            }
            let lens = self.lens_of[view];
            let log_focal = self.lens(lens)[0];
            let focal = adjoint.focal.dot(base.focal * log_focal.exp());
            let point = adjoint.principal * self.scale(view, base);
            let own = [focal, point.x, point.y, adjoint.radial.x, adjoint.radial.y];
            let free = self.freedom.of_lens().map(|i| (i, own[i]));
            self.add(&mut gradient, self.first_of_lens(lens), free);
        }
        gradient.iter_mut().zip(&self.parameters).for_each(|(g, p)| *g += prior * p);
        gradient
    }

    /// Adds adjoints to the gradient from parameter `first` on, in pixels.
    fn add(
        &self,
        gradient: &mut [f64],
        first: usize,
        adjoints: impl Iterator<Item = (usize, f64)>,
    ) {
        for (i, adjoint) in adjoints {
            gradient[first + i] += adjoint * self.units[first + i];
        }
    }

    /// The rotation vector and the shift of a view.
    fn pose(&self, view: usize) -> (DVec3, DVec3) {
        let [a, b, c, x, y, z] = self.values::<OF_POSE>(OF_POSE * view);
        (DVec3::new(a, b, c), DVec3::new(x, y, z))
    }

    pub(crate) fn lens(&self, lens: usize) -> [f64; OF_LENS] {
        self.values(self.first_of_lens(lens))
    }

    pub(crate) fn first_of_lens(&self, lens: usize) -> usize {
        OF_POSE * self.given.len() + OF_LENS * lens
    }

    /// N parameters in their own units.
    pub(crate) fn values<const N: usize>(&self, first: usize) -> [f64; N] {
        std::array::from_fn(|i| self.parameters[first + i] * self.units[first + i])
    }

    /// The size of `base` relative to that of the given camera of a view.
    fn scale(&self, view: usize, base: &Camera) -> DVec2 {
        base.focal / self.given[view].focal
    }

    /// The correction of each view.
    pub fn corrections(&self) -> Vec<Correction> {
        let cameras = self.cameras();
        let of_view = |(view, (given, now)): (usize, (&Camera, &Camera))| {
            let (turn, shift) = self.pose(view);
            let seen = |camera: &Camera| camera.project(self.sphere.center);
            let pixels = match (seen(given), seen(now)) {
                (Some(a), Some(b)) => a.distance(b),
                _ => 0.0,
            };
            Correction { degrees: turn.length().to_degrees(), shift: shift.to_array(), pixels }
        };
        self.given.iter().zip(&cameras).enumerate().map(of_view).collect()
    }

    /// The median motion of the image of the bounding sphere's centre, in pixels.
    pub(crate) fn median_pixels(&self) -> f64 {
        let mut pixels: Vec<f64> = self.corrections().iter().map(|c| c.pixels).collect();
        median(&mut pixels)
    }

    /// The parameters, the running means of the gradient and of its square, and the number of
    /// steps: the state from which a run can continue.
    pub fn state(&self) -> (&[f64], &[f64], &[f64], u64) {
        let (first, second, steps) = self.adam.state();
        (&self.parameters, first, second, steps)
    }

    /// Restores the state that [`state`](Self::state) returned.
    ///
    /// # Errors
    /// If a length is wrong, or a number is not one that a run can produce.
    pub fn restore(
        &mut self,
        parameters: &[f64],
        first: &[f64],
        second: &[f64],
        steps: u64,
    ) -> Result<(), CalibrationError> {
        let (found, expected) = (parameters.len(), self.parameters.len());
        if found != expected || parameters.iter().any(|p| p.is_nan() || p.abs() > MAX_CORRECTION) {
            return Err(CalibrationError::Count { found, expected });
        }
        self.adam.restore(first, second, steps)?;
        self.parameters.copy_from_slice(parameters);
        Ok(())
    }
}

/// VJP of a rotation vector v ↦ exp(v), for the adjoint of a further small rotation.
///
/// A change v̇ turns by J v̇ with the left Jacobian J of SO(3), here to second order in v: J = I +
/// [v]×/2 + [v]×²/6 (Solà, Deray and Atchuthan, "A micro Lie theory for state estimation in
/// robotics", 2018, equation 145).
fn rotation_vjp(v: DVec3, adjoint: DVec3) -> DVec3 {
    let once = adjoint.cross(v);
    adjoint + once * 0.5 + once.cross(v) / 6.0
}
