//! Derivatives of the shaders that a scene file describes, against central differences.

use field::{Shape, SurfaceAdjoint, SurfaceBatch};
use glam::DVec3;
use proptest::prelude::*;

use super::*;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 3.0 };

/// Direction of the directional light and position of the point light.
const TO_LIGHT: DVec3 = DVec3::new(0.3, 0.5, 0.9);
const LAMP: DVec3 = DVec3::new(-1.0, 2.0, 1.5);

/// A Lambertian appearance with a directional light and a point light.
fn lambert(shadows: bool) -> AppearanceModel {
    let parameters = [
        [0.8, 0.6, 0.4, 0.1, 0.2, 0.3].as_slice(),
        &[0.3, 0.5, 0.9, 1.0, 0.9, 0.8],
        &[-1.0, 2.0, 1.5, 2.0, 3.0, 4.0],
    ]
    .concat();
    let lights = vec![Light::Directional, Light::Point];
    model(Appearance::Lambert { lights, shadows }, parameters)
}

fn model(appearance: Appearance, parameters: Vec<f64>) -> AppearanceModel {
    AppearanceModel { appearance, parameters, pointers: Vec::new() }
}

/// The scalar adjoint · radiance at the point `x` with the normal `n`.
fn dotted_radiance(
    model: &AppearanceModel,
    solid: &dyn Field<f64>,
    x: DVec3,
    n: DVec3,
    adjoint: DVec3,
) -> f64 {
    let mut rgb = [DVec3::ZERO];
    let shader = model.build::<f64>(DVec3::ZERO, solid, BOUNDS).unwrap();
    shader.radiance(&SurfaceBatch { x: &[x], normal: &[n], direction: &[DVec3::Z] }, &mut rgb);
    rgb[0].dot(adjoint)
}

/// Compares every derivative of a shader with central differences. The point must not be near a
/// kink (a light at grazing incidence, a shadow's edge).
fn check(model: &AppearanceModel, solid: &dyn Field<f64>, x: DVec3, n: DVec3, adjoint: DVec3) {
    const H: f64 = 1e-6;
    let radiance = |model: &AppearanceModel, x, n| dotted_radiance(model, solid, x, n, adjoint);
    let shader = model.build::<f64>(DVec3::ZERO, solid, BOUNDS).unwrap();
    // The VJP overwrites these.
    let nan = vec![DVec3::NAN];
    let mut bars = SurfaceAdjoint::<f64> { x: nan.clone(), normal: nan.clone(), direction: nan };
    let mut parameters = vec![0.0; shader.parameter_count()];
    let point = SurfaceBatch { x: &[x], normal: &[n], direction: &[DVec3::Z] };
    shader.vjp(&point, &[adjoint], &mut bars, &mut parameters);
    let close = |derivative: f64, plus: f64, minus: f64, name: &str| {
        let difference = (plus - minus) / (2.0 * H);
        assert!(
            (derivative - difference).abs() < 1e-6 * (1.0 + difference.abs()),
            "by {name}: derivative {derivative}, central difference {difference}"
        );
    };
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let e = axis * H;
        close(bars.x[0].dot(axis), radiance(model, x + e, n), radiance(model, x - e, n), "x");
        close(bars.normal[0].dot(axis), radiance(model, x, n + e), radiance(model, x, n - e), "n");
    }
    assert_eq!(bars.direction[0], DVec3::ZERO);
    for (j, parameter) in parameters.iter().enumerate() {
        let changed = |h: f64| {
            let mut changed = model.clone();
            changed.parameters[j] += h;
            radiance(&changed, x, n)
        };
        close(*parameter, changed(H), changed(-H), &format!("parameter {j}"));
    }
}

/// True if no light is at grazing incidence, and the point light is not too close.
fn away_from_kinks(x: DVec3, n: DVec3) -> bool {
    let to_lamp = LAMP - x;
    n.dot(TO_LIGHT).abs() > 0.05 && n.dot(to_lamp).abs() > 0.05 && to_lamp.length() > 0.3
}

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from)
}

proptest! {
    #[test]
    fn derivatives_match_differences(x in vector(), n in vector(), adjoint in vector()) {
        prop_assume!(n.length() > 0.2);
        let (n, far) = (n.normalize(), Shape::<f64>::sphere([0.0, 0.0, -50.0], 0.1));
        prop_assume!(away_from_kinks(x, n));
        check(&lambert(false), &far, x, n, adjoint);
        check(&model(Appearance::Constant, vec![0.1, 0.2, 0.3]), &far, x, n, adjoint);
        check(&model(Appearance::Normal, Vec::new()), &far, x, n, adjoint);
    }

    #[test]
    fn derivatives_in_shadow_are_those_of_the_unblocked_lights(
        x in vector(),
        adjoint in vector(),
    ) {
        // A ball over a floor blocks the directional light in one disc of the floor and the point
        // light in another.
        let x = DVec3::new(x.x * 1.5, x.y * 1.5, -1.0);
        let ball = Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4);
        // Not at a shadow's edge: the line to each light passes the ball's surface at a distance of
        // 0.01 or more.
        let margin = |to_light: DVec3| {
            ((-x).reject_from_normalized(to_light.normalize()).length() - 0.4).abs() > 0.01
        };
        prop_assume!(margin(TO_LIGHT) && margin(LAMP - x));
        check(&lambert(true), &ball, x, DVec3::Z, adjoint);
    }
}

#[test]
fn a_blocked_light_has_no_derivative() {
    let ball = Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4);
    let behind = -TO_LIGHT.normalize() * 1.1;
    let model = lambert(true);
    let shader = model.build::<f64>(DVec3::ZERO, &ball, BOUNDS).unwrap();
    let mut parameters = vec![0.0; shader.parameter_count()];
    let point = SurfaceBatch { x: &[behind], normal: &[DVec3::Z], direction: &[DVec3::Z] };
    shader.vjp(&point, &[DVec3::ONE], &mut SurfaceAdjoint::zeros(1), &mut parameters);
    assert_eq!(&parameters[9..12], &[0.0; 3], "derivative by the blocked light's radiance");
}

#[test]
fn nan_in_a_point_or_normal_gives_no_finite_radiance() {
    let ball = Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4);
    let model = lambert(false);
    let shader = model.build::<f64>(DVec3::ZERO, &ball, BOUNDS).unwrap();
    let mut rgb = [DVec3::ZERO; 2];
    let (x, normal) = ([DVec3::ONE, DVec3::NAN], [DVec3::NAN, DVec3::Z]);
    shader.radiance(&SurfaceBatch { x: &x, normal: &normal, direction: &[DVec3::Z; 2] }, &mut rgb);
    assert!(rgb.iter().all(|c| !c.is_finite()), "{rgb:?}");
}
