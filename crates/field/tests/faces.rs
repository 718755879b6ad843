//! The numbers of faces: equal on one smooth part of a surface, different across its creases.

use field::{Clipped, Csg, Field, Kind, Operation, Shape, Sphere};
use glam::DVec3;

fn faces(field: &dyn Field<f64>, x: &[DVec3]) -> Vec<u32> {
    let mut face = vec![0; x.len()];
    field.faces(x, &mut face);
    face
}

/// The number of different faces among points.
fn count(field: &dyn Field<f64>, x: &[DVec3]) -> usize {
    let mut face = faces(field, x);
    face.sort_unstable();
    face.dedup();
    face.len()
}

#[test]
fn a_box_has_six_faces() {
    let cuboid = Shape::<f64>::new(Kind::Box, &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    let sides = [DVec3::X, 2.0 * DVec3::Y, 3.0 * DVec3::Z];
    let middles: Vec<DVec3> = sides.iter().flat_map(|side| [*side, -*side]).collect();
    assert_eq!(count(&cuboid, &middles), 6);
    // Points of the side x = 1 near its edges.
    let side = [(1.9, 2.9), (-1.9, 2.9), (0.0, -2.9)].map(|(y, z)| DVec3::new(1.0, y, z));
    assert_eq!(count(&cuboid, &side), 1);
    assert!(cuboid.has_creases());
}

#[test]
fn balls_of_a_combination_have_a_face_each() {
    let balls = || -> Vec<Box<dyn Field<f64>>> {
        [-0.5, 0.5].map(|x| Box::new(Shape::sphere([x, 0.0, 0.0], 1.0)) as _).into()
    };
    let (left, right) = (DVec3::new(-1.5, 0.0, 0.0), DVec3::new(1.5, 0.0, 0.0));
    let union = Csg::new(Operation::Union, balls());
    assert_eq!(count(&union, &[left, DVec3::new(-0.5, 1.0, 0.0)]), 1);
    assert_eq!(count(&union, &[left, right]), 2);
    let lens = Csg::new(Operation::Intersection, balls());
    // The left side of the lens is a part of the right ball.
    assert_eq!(count(&lens, &[DVec3::new(-0.5, 0.0, 0.0), DVec3::new(0.5, 0.0, 0.0)]), 2);
    assert!(union.has_creases() && lens.has_creases());
    let smooth = Csg::smooth_union(0.2, balls());
    assert!(!smooth.has_creases());
}

#[test]
fn a_cap_is_a_face() {
    let plane = Shape::<f64>::new(Kind::Plane, &[0.0, 1.0, 0.0, 0.25]);
    let clipped = Clipped::new(plane, Sphere { center: DVec3::ZERO, radius: 1.0 });
    let (top, cap) = (DVec3::new(0.3, 0.25, 0.0), DVec3::new(0.0, -1.0, 0.0));
    let mut f = [0.0; 2];
    clipped.value(&[top, cap], &mut f);
    assert_eq!(f, [0.0, 0.0]);
    assert_eq!(count(&clipped, &[top, DVec3::new(-0.3, 0.25, 0.5)]), 1);
    assert_eq!(count(&clipped, &[top, cap]), 2);
}
