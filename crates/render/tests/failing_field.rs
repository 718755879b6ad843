//! A field that a callback evaluates: where the callback fails, rendering ends with an error.

use std::sync::Mutex;

use field::UniformBackground;
use field::{Field, Shape, Sphere};
use glam::{DVec2, DVec3};
use render::{Analytic, Camera, Formula, Scene, render};

/// A ball whose evaluations fail after a number of calls.
struct Failing {
    ball: Shape<f64>,
    calls_left: Mutex<usize>,
    cause: Mutex<Option<String>>,
}

impl Failing {
    fn after(calls: usize) -> Self {
        let ball = Shape::sphere([0.0; 3], 1.0);
        Failing { ball, calls_left: Mutex::new(calls), cause: Mutex::new(None) }
    }

    /// Counts a call. A failed call keeps its cause.
    fn fails(&self) -> bool {
        let mut left = self.calls_left.lock().unwrap_or_else(|e| e.into_inner());
        if *left == 0 {
            let mut cause = self.cause.lock().unwrap_or_else(|e| e.into_inner());
            cause.get_or_insert("the device is gone".to_owned());
            return true;
        }
        *left -= 1;
        false
    }
}

impl Field<f64> for Failing {
    fn parameter_count(&self) -> usize {
        self.ball.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        self.ball.bounds()
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        self.ball.value(x, f);
        if self.fails() {
            f.fill(f64::NAN);
        }
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        self.ball.value_gradient(x, f, gradient);
        if self.fails() {
            f.fill(f64::NAN);
            gradient.fill(DVec3::NAN);
        }
    }
    fn hessian_vector(&self, _: &[DVec3], _: &[DVec3], _: &mut [DVec3], product: &mut [DVec3]) {
        product.fill(DVec3::NAN);
    }
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], adjoint: &mut [f64]) {
        adjoint.fill(f64::NAN);
    }
}

/// Renders a ball with a field that fails after `calls` calls.
fn render_failing(calls: usize) -> (bool, Failing) {
    let field = Failing::after(calls);
    let (focal, principal) = (DVec2::splat(16.0), DVec2::splat(8.0));
    let eye = DVec3::new(0.0, 0.0, 4.0);
    let camera = Camera::look_at(16, 16, focal, principal, eye, DVec3::ZERO, DVec3::Y);
    let cameras = [camera.unwrap_or_else(|| panic!("a camera"))];
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.5 };
    let shader = Analytic { formula: Formula::Normal, parameters: Vec::new() };
    let scene = Scene::new(&field, &shader, &cameras, &bounds, &UniformBackground(DVec3::ZERO));
    let succeeds = render(&scene, 0, 4, 1, &|_| {}).is_ok();
    (succeeds, field)
}

#[test]
fn a_callback_that_fails_at_any_call_ends_rendering_and_keeps_its_cause() {
    let (succeeds, field) = render_failing(usize::MAX);
    assert!(succeeds);
    let calls = usize::MAX - field.calls_left.into_inner().unwrap_or_else(|e| e.into_inner());
    assert!(calls > 10, "{calls} calls");
    for failing in 0..calls {
        let (succeeds, field) = render_failing(failing);
        let cause = field.cause.into_inner().unwrap_or_else(|e| e.into_inner());
        assert!(!succeeds, "the failure at call {failing} of {calls} is not seen");
        assert_eq!(cause.as_deref(), Some("the device is gone"));
    }
}
