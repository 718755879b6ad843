//! Analytic fields in f64: every derivative against finite differences, inputs that are not finite,
//! and bounds.

use approx::assert_relative_eq;
use field::{Clipped, Csg, Field, Kind, Operation, Shape, Sphere};
use glam::DVec3;
use proptest::prelude::*;

type Children = Vec<Box<dyn Field<f64>>>;

/// Builds a field from its parameters.
type Build = fn(&[f64]) -> Box<dyn Field<f64>>;

/// A torus with the first 8 parameters and a capsule with the next 7.
fn torus_and_capsule(p: &[f64]) -> Children {
    let torus = Shape::new(Kind::Torus, &p[..8]);
    let capsule = Shape::new(Kind::Capsule, &p[8..15]);
    vec![Box::new(torus), Box::new(capsule)]
}

const TORUS: [f64; 8] = [0.1, -0.2, 0.3, 0.3, 0.2, 1.1, 0.8, 0.25];
const CAPSULE: [f64; 7] = [-0.6, 0.1, 0.2, 0.7, 0.4, -0.3, 0.3];

/// Every case has a name, parameters, and the function that builds its field.
fn cases() -> Vec<(&'static str, Vec<f64>, Build)> {
    let pair = [&TORUS[..], &CAPSULE].concat();
    vec![
        ("sphere", vec![0.1, 0.2, -0.3, 0.7], |p| Box::new(Shape::new(Kind::Sphere, p))),
        ("box", vec![0.1, 0.2, -0.3, 0.7, 0.4, 0.5], |p| Box::new(Shape::new(Kind::Box, p))),
        ("torus", TORUS.to_vec(), |p| Box::new(Shape::new(Kind::Torus, p))),
        ("capsule", CAPSULE.to_vec(), |p| Box::new(Shape::new(Kind::Capsule, p))),
        ("plane", vec![0.3, -1.2, 0.4, 0.2], |p| Box::new(Shape::new(Kind::Plane, p))),
        ("union", pair.clone(), |p| Box::new(Csg::new(Operation::Union, torus_and_capsule(p)))),
        ("intersection", pair.clone(), |p| {
            Box::new(Csg::new(Operation::Intersection, torus_and_capsule(p)))
        }),
        ("subtraction", pair.clone(), |p| {
            Box::new(Csg::new(Operation::Subtraction, torus_and_capsule(p)))
        }),
        ("clipped", TORUS.to_vec(), |p| {
            let ball = Sphere { center: DVec3::new(0.5, 0.0, 0.3), radius: 0.9 };
            Box::new(Clipped::new(Shape::new(Kind::Torus, p), ball))
        }),
        ("smooth union", [&pair[..], &[0.6]].concat(), |p| {
            Box::new(Csg::smooth_union(p[15], torus_and_capsule(p)))
        }),
    ]
}

fn value(field: &dyn Field<f64>, x: DVec3) -> f64 {
    let mut f = [0.0];
    field.value(&[x], &mut f);
    f[0]
}

fn gradient(field: &dyn Field<f64>, x: DVec3) -> DVec3 {
    let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
    field.value_gradient(&[x], &mut f, &mut g);
    assert_relative_eq!(f[0], value(field, x), epsilon = 1e-14);
    g[0]
}

/// The central difference of `f` at 0 with step `h`/2, or `None` if `f` has a kink within `h`.
fn difference(h: f64, f: impl Fn(f64) -> f64) -> Option<f64> {
    let coarse = (f(h) - f(-h)) / (2.0 * h);
    let fine = (f(h / 2.0) - f(-h / 2.0)) / h;
    let one_sided = (f(h) - f(0.0)) / h - (f(0.0) - f(-h)) / h;
    ((coarse - fine).abs() < 1e-6 && one_sided.abs() < 1e-2).then_some(fine)
}

fn point() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.5..1.5f64).prop_map(DVec3::from)
}

proptest! {
    #[test]
    fn spatial_derivatives_match_finite_differences(x in point(), p in point()) {
        for (name, parameters, build) in cases() {
            let field = build(&parameters);
            let g = gradient(&*field, x);
            let (mut g2, mut hp) = ([DVec3::ZERO], [DVec3::ZERO]);
            field.hessian_vector(&[x], &[p], &mut g2, &mut hp);
            assert_relative_eq!(g, g2[0], epsilon = 1e-13);
            for (axis, e) in DVec3::AXES.into_iter().enumerate() {
                if let Some(d) = difference(1e-4, |h| value(&*field, x + h * e)) {
                    prop_assert!(
                        (g[axis] - d).abs() < 1e-5,
                        "{name}: ∇f[{axis}] is {}, the finite difference {d}",
                        g[axis]
                    );
                    let change = difference(1e-4, |h| gradient(&*field, x + h * p)[axis]);
                    let kink = difference(1e-3, |h| value(&*field, x + h * p)).is_none();
                    if let (Some(d), false) = (change, kink) {
                        prop_assert!(
                            (hp[0][axis] - d).abs() < 1e-4 * (1.0 + d.abs()),
                            "{name}: (∇²f p)[{axis}] is {}, the finite difference {d}",
                            hp[0][axis]
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn parameter_derivatives_match_finite_differences(
        x in point(),
        c in point(),
        alpha in -1.0..1.0f64,
    ) {
        for (name, parameters, build) in cases() {
            let n = parameters.len();
            let mut adjoint = vec![0.0; n];
            build(&parameters).parameter_vjp(&[x], &[alpha], &[c], &mut adjoint);
            for j in 0..n {
                let moved = |h: f64| {
                    let mut p = parameters.clone();
                    p[j] += h;
                    build(&p)
                };
                let value_slope = difference(1e-4, |h| value(&*moved(h), x));
                let total = difference(1e-4, |h| {
                    let field = moved(h);
                    alpha * value(&*field, x) + c.dot(gradient(&*field, x))
                });
                if let (Some(_), Some(d)) = (value_slope, total) {
                    prop_assert!(
                        (adjoint[j] - d).abs() < 1e-4 * (1.0 + d.abs()),
                        "{name}: adjoint of parameter {j} is {}, the finite difference {d}",
                        adjoint[j]
                    );
                }
                // The JVP (of shapes their own, of CSG the provided one) is the VJP's transpose.
                let mut tangent = vec![0.0; n];
                tangent[j] = 1.0;
                let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
                build(&parameters).parameter_jvp(&[x], &tangent, &mut f, &mut g);
                assert_relative_eq!(
                    alpha * f[0] + c.dot(g[0]),
                    adjoint[j],
                    epsilon = 1e-11,
                    max_relative = 1e-11
                );
            }
        }
    }

    #[test]
    fn extreme_points_do_not_panic_and_non_finite_ones_give_non_finite_values(
        i in 0usize..3,
        extreme in prop::sample::select(vec![
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            1e30,
            -1e30,
            1e-310,
        ]),
    ) {
        for (_, parameters, build) in cases() {
            let field = build(&parameters);
            let mut x = DVec3::new(0.1, 0.2, 0.3);
            x[i] = extreme;
            let mut out = ([0.0], [DVec3::ZERO], [DVec3::ZERO]);
            field.value_gradient(&[x], &mut out.0, &mut out.1);
            prop_assert!(extreme.is_finite() || !out.0[0].is_finite());
            field.hessian_vector(&[x], &[DVec3::X], &mut out.1, &mut out.2);
            field.parameter_vjp(&[x], &[1.0], &[DVec3::X], &mut vec![0.0; parameters.len()]);
        }
    }

    #[test]
    fn bounds_contain_the_solid(x in point()) {
        for (name, parameters, build) in cases() {
            let field = build(&parameters);
            if let Some(ball) = field.bounds() && value(&*field, x) <= 0.0 {
                prop_assert!(
                    (x - ball.center).length() <= ball.radius + 1e-12,
                    "{name}: the point {x} of the solid is outside its bounds"
                );
            }
        }
    }
}

#[test]
fn gradients_on_medial_axes_are_finite() {
    let sphere = Shape::<f64>::sphere([0.0; 3], 1.0);
    assert_eq!(gradient(&sphere, DVec3::ZERO), DVec3::ZERO);
    let torus = Shape::<f64>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.2]);
    assert!(gradient(&torus, DVec3::ZERO).is_finite());
}

#[test]
fn single_precision_agrees_with_double_precision() {
    for x in [DVec3::new(0.3, -0.9, 0.4), DVec3::new(-1.2, 0.1, 0.8)] {
        let (mut f, mut g) = ([0.0f32], [glam::Vec3::ZERO]);
        let single = Shape::<f32>::new(Kind::Torus, &TORUS);
        single.value_gradient(&[x.as_vec3()], &mut f, &mut g);
        let double = Shape::<f64>::new(Kind::Torus, &TORUS);
        assert_relative_eq!(f64::from(f[0]), value(&double, x), epsilon = 1e-6);
        assert_relative_eq!(g[0].as_dvec3(), gradient(&double, x), epsilon = 1e-5);
    }
}
