//! Shapes in coordinates relative to a distant point.

use approx::assert_relative_eq;
use field::{Field, Kind, Shape};
use glam::{DVec3, Vec3};

const SHAPES: [(Kind, &[f64]); 5] = [
    (Kind::Sphere, &[0.1, 0.2, -0.3, 0.7]),
    (Kind::Box, &[0.1, 0.2, -0.3, 0.7, 0.4, 0.5]),
    (Kind::Torus, &[0.1, -0.2, 0.3, 0.3, 0.2, 1.1, 0.8, 0.25]),
    (Kind::Capsule, &[-0.6, 0.1, 0.2, 0.7, 0.4, -0.3, 0.3]),
    (Kind::Plane, &[0.3, -1.2, 0.4, 0.2]),
];

const POINTS: [DVec3; 3] =
    [DVec3::new(1.1, 0.3, -0.4), DVec3::new(-0.7, 0.9, 1.2), DVec3::new(0.4, -1.3, 0.6)];

/// The value and the derivatives by every parameter, at a point.
fn derivatives(shape: &Shape<f64>, x: DVec3) -> Vec<f64> {
    let n = shape.parameter_count();
    let mut out = vec![0.0];
    shape.value(&[x], &mut out);
    for i in 0..n {
        let mut tangent = vec![0.0; n];
        tangent[i] = 1.0;
        let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
        shape.parameter_jvp(&[x], &tangent, &mut f, &mut g);
        out.extend([f[0], g[0].x, g[0].y, g[0].z]);
    }
    out
}

#[test]
fn values_and_derivatives_are_those_of_the_world() {
    let origin = DVec3::new(3.0, -2.0, 5.0);
    for (kind, parameters) in SHAPES {
        let world = Shape::<f64>::new(kind, parameters);
        let relative = Shape::<f64>::about(origin.to_array(), kind, parameters);
        for x in POINTS {
            let (expected, found) = (derivatives(&world, x), derivatives(&relative, x - origin));
            for (expected, found) in expected.iter().zip(&found) {
                assert_relative_eq!(found, expected, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn a_distant_shape_keeps_the_digits_of_single_precision() {
    let origin = DVec3::new(1e6, 2e6, -3e6);
    for (kind, parameters) in SHAPES {
        let mut distant = parameters.to_vec();
        let starts: &[usize] = match kind {
            Kind::Capsule => &[0, 3],
            Kind::Plane => &[],
            _ => &[0],
        };
        for start in starts {
            (0..3).for_each(|i| distant[start + i] += origin[i]);
        }
        if kind == Kind::Plane {
            let normal = DVec3::from_slice(&distant);
            distant[3] += origin.dot(normal.normalize());
        }
        let near = Shape::<f64>::new(kind, parameters);
        let far = Shape::<f32>::about(origin.to_array(), kind, &distant);
        for x in POINTS {
            let (mut expected, mut found) = ([0.0f64], [0.0f32]);
            near.value(&[x], &mut expected);
            far.value(&[x.as_vec3()], &mut found);
            // Double precision itself has 1e-9 units at this distance.
            assert_relative_eq!(f64::from(found[0]), expected[0], epsilon = 1e-6);
        }
    }
}

/// Rounding to single precision is that of the world where the origin is the world's.
#[test]
fn the_origin_of_the_world_changes_no_bit() {
    for (kind, parameters) in SHAPES {
        let (a, b) =
            (Shape::<f32>::new(kind, parameters), Shape::about([0.0; 3], kind, parameters));
        for x in POINTS.map(|x| x.as_vec3()) {
            let (mut f, mut g) = ([[0.0f32]; 2], [[Vec3::ZERO]; 2]);
            a.value_gradient(&[x], &mut f[0], &mut g[0]);
            b.value_gradient(&[x], &mut f[1], &mut g[1]);
            assert_eq!((f[0], g[0]), (f[1], g[1]));
        }
    }
}
