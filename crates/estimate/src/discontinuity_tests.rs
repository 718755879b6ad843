use super::Discontinuity::{Creases, ShadowEdges, Silhouettes};
use super::*;
use crate::{EstimatorOptions, Registry};
use field::{Csg, Field, Kind, Operation, Shape, Sphere};
use field::{Shader, UniformBackground};
use glam::DVec3;
use render::{Analytic, Formula, Light, Shadowed};

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 2.0 };

/// A Lambertian shader with one light.
fn lambert() -> Analytic<f64> {
    let parameters = vec![0.8, 0.6, 0.4, 0.1, 0.2, 0.3, 0.5, 0.7, 0.6, 1.0, 1.0, 1.0];
    Analytic { formula: Formula::Lambert { lights: vec![Light::Directional] }, parameters }
}

/// The discontinuities that each estimator leaves out, by its name.
fn left_out(
    field: &dyn Field<f64>,
    shader: &dyn Shader<f64>,
) -> Vec<(&'static str, Vec<Discontinuity>)> {
    let scene = Scene::new(field, shader, &[], &BOUNDS, &UniformBackground(DVec3::ZERO));
    let registry = Registry::default();
    let of = |entry: &crate::Entry| {
        let estimator = entry.estimator::<f64>(&EstimatorOptions::default());
        (entry.name, estimator.unmodelled(&scene))
    };
    registry.entries().iter().map(of).collect()
}

/// Checks the lists of `refined` and `contour`, of `interior`, and of all others.
fn check(field: &dyn Field<f64>, shader: &dyn Shader<f64>, expected: [&[Discontinuity]; 3]) {
    for (name, found) in left_out(field, shader) {
        let group = match name {
            "refined" | "contour" => 0,
            "interior" => 1,
            _ => 2,
        };
        assert_eq!(found, expected[group], "{name}");
    }
}

#[test]
fn estimators_declare_the_discontinuities_that_they_leave_out() {
    let (ball, cube) =
        (Shape::sphere([0.0; 3], 0.7), Shape::new(Kind::Box, &[0.0, 0.0, 0.0, 0.5, 0.5, 0.5]));
    let pair = || {
        let ball = |x| Box::new(Shape::sphere([x, 0.0, 0.0], 0.6)) as Box<dyn Field<f64>>;
        vec![ball(-0.3), ball(0.3)]
    };
    let (union, smooth) = (Csg::new(Operation::Union, pair()), Csg::smooth_union(0.2, pair()));
    let white = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    for smooth in [&ball as &dyn Field<f64>, &smooth] {
        check(smooth, &lambert(), [&[], &[Silhouettes], &[]]);
    }
    for creased in [&cube as &dyn Field<f64>, &union] {
        check(creased, &lambert(), [&[], &[Silhouettes, Creases], &[Creases]]);
        // The radiance does not jump with the normal.
        check(creased, &white, [&[], &[Silhouettes], &[]]);
    }
    let shadowed = Shadowed { analytic: lambert(), occluders: &cube, bounds: BOUNDS };
    let all = [Silhouettes, Creases, ShadowEdges];
    check(&cube, &shadowed, [&all[2..], &all, &all[1..]]);
    assert_eq!(all.map(Discontinuity::name), ["silhouettes", "creases", "shadow edges"]);
}
