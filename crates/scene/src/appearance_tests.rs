use super::*;
use field::{Shape, SurfaceAdjoint, SurfaceBatch};
use glam::DVec3;
use proptest::prelude::*;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 3.0 };

fn lambert(shadows: bool) -> AppearanceModel {
    let parameters = [
        [0.8, 0.6, 0.4, 0.1, 0.2, 0.3].as_slice(),
        &[0.3, 0.5, 0.9, 1.0, 0.9, 0.8],
        &[-1.0, 2.0, 1.5, 2.0, 3.0, 4.0],
    ]
    .concat();
    let appearance =
        Appearance::Lambert { lights: vec![Light::Directional, Light::Point], shadows };
    AppearanceModel { appearance, parameters, pointers: Vec::new() }
}

fn plain(appearance: Appearance, parameters: Vec<f64>) -> AppearanceModel {
    AppearanceModel { appearance, parameters, pointers: Vec::new() }
}

/// Σ adjoint · radiance at one point.
fn seen(
    model: &AppearanceModel,
    solid: &dyn Field<f64>,
    x: DVec3,
    n: DVec3,
    adjoint: DVec3,
) -> f64 {
    let mut rgb = [DVec3::ZERO];
    let shader = model.build::<f64>(solid, BOUNDS).unwrap();
    shader.radiance(&SurfaceBatch { x: &[x], normal: &[n], direction: &[DVec3::Z] }, &mut rgb);
    rgb[0].dot(adjoint)
}

/// Every derivative of a shader against central differences, at a point that is not near a kink (a
/// light at grazing incidence, a shadow's edge).
fn check(model: &AppearanceModel, solid: &dyn Field<f64>, x: DVec3, n: DVec3, adjoint: DVec3) {
    const H: f64 = 1e-6;
    let shader = model.build::<f64>(solid, BOUNDS).unwrap();
    let nan = vec![DVec3::NAN];
    let mut bars = SurfaceAdjoint::<f64> { x: nan.clone(), normal: nan.clone(), direction: nan };
    let mut parameters = vec![0.0; shader.parameter_count()];
    let point = SurfaceBatch { x: &[x], normal: &[n], direction: &[DVec3::Z] };
    shader.vjp(&point, &[adjoint], &mut bars, &mut parameters);
    let close = |got: f64, plus: f64, minus: f64, what: &str| {
        let difference = (plus - minus) / (2.0 * H);
        assert!(
            (got - difference).abs() < 1e-6 * (1.0 + difference.abs()),
            "{what}: {got} against {difference}"
        );
    };
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let e = axis * H;
        close(
            bars.x[0].dot(axis),
            seen(model, solid, x + e, n, adjoint),
            seen(model, solid, x - e, n, adjoint),
            "x",
        );
        close(
            bars.normal[0].dot(axis),
            seen(model, solid, x, n + e, adjoint),
            seen(model, solid, x, n - e, adjoint),
            "n",
        );
    }
    assert_eq!(bars.direction[0], DVec3::ZERO);
    for (j, parameter) in parameters.iter().enumerate() {
        let moved = |h: f64| {
            let mut moved = model.clone();
            moved.parameters[j] += h;
            seen(&moved, solid, x, n, adjoint)
        };
        close(*parameter, moved(H), moved(-H), &format!("parameter {j}"));
    }
}

/// The cosine to each light at a point: away from zero, no kink is near.
fn clear(x: DVec3, n: DVec3) -> bool {
    let point = DVec3::new(-1.0, 2.0, 1.5) - x;
    n.dot(DVec3::new(0.3, 0.5, 0.9)).abs() > 0.05
        && n.dot(point).abs() > 0.05
        && point.length() > 0.3
}

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from)
}

proptest! {
    #[test]
    fn derivatives_match_differences(x in vector(), n in vector(), adjoint in vector()) {
        prop_assume!(n.length() > 0.2);
        let (n, far) = (n.normalize(), Shape::<f64>::sphere([0.0, 0.0, -50.0], 0.1));
        prop_assume!(clear(x, n));
        check(&lambert(false), &far, x, n, adjoint);
        check(&plain(Appearance::Constant, vec![0.1, 0.2, 0.3]), &far, x, n, adjoint);
        check(&plain(Appearance::Normal, Vec::new()), &far, x, n, adjoint);
    }

    #[test]
    fn derivatives_in_shadow_are_those_of_the_light_that_is_left(x in vector(), adjoint in vector()) {
        // A ball over a floor: the directional light is blocked in a disc, the point light in
        // another.
        let (x, ball) = (DVec3::new(x.x * 1.5, x.y * 1.5, -1.0), Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4));
        let model = lambert(true);
        // Not at a shadow's edge: the ray to each light clears the ball's surface by a margin.
        let margin = |to: DVec3| ((-x).reject_from_normalized(to.normalize()).length() - 0.4).abs() > 0.01;
        prop_assume!(margin(DVec3::new(0.3, 0.5, 0.9)) && margin(DVec3::new(-1.0, 2.0, 1.5) - x));
        check(&model, &ball, x, DVec3::Z, adjoint);
    }
}

#[test]
fn a_shadow_blocks_its_light_in_the_derivative_too() {
    let ball = Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4);
    let light = DVec3::new(0.3, 0.5, 0.9).normalize();
    let behind = -light * 1.1;
    let model = lambert(true);
    let shader = model.build::<f64>(&ball, BOUNDS).unwrap();
    let mut parameters = vec![0.0; shader.parameter_count()];
    let point = SurfaceBatch { x: &[behind], normal: &[DVec3::Z], direction: &[DVec3::Z] };
    shader.vjp(&point, &[DVec3::ONE], &mut SurfaceAdjoint::zeros(1), &mut parameters);
    assert_eq!(&parameters[9..12], &[0.0; 3], "the blocked light's radiance changes nothing");
}

#[test]
fn poison_stays_poison() {
    let ball = Shape::<f64>::sphere([0.0, 0.0, 0.0], 0.4);
    let shader = lambert(false);
    let shader = shader.build::<f64>(&ball, BOUNDS).unwrap();
    let mut rgb = [DVec3::ZERO; 2];
    let (x, normal) = ([DVec3::ONE, DVec3::NAN], [DVec3::NAN, DVec3::Z]);
    shader.radiance(&SurfaceBatch { x: &x, normal: &normal, direction: &[DVec3::Z; 2] }, &mut rgb);
    assert!(rgb.iter().all(|c| !c.is_finite()), "{rgb:?}");
}
