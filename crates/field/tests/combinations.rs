//! Combinations of solids: batches of points, bounds, faces and the properties that the tracer
//! relies on.

use approx::assert_relative_eq;
use field::{Csg, Field, Kind, Operation, Shape, Sphere};
use glam::DVec3;

type Children = Vec<Box<dyn Field<f64>>>;

fn ball(center: [f64; 3], radius: f64) -> Box<dyn Field<f64>> {
    Box::new(Shape::sphere(center, radius))
}

fn children() -> Children {
    let capsule = Shape::new(Kind::Capsule, &[-0.6, 0.1, 0.2, 0.7, 0.4, -0.3, 0.3]);
    let cuboid = Shape::new(Kind::Box, &[-0.3, 0.2, 0.0, 0.4, 0.3, 0.2]);
    vec![ball([0.2, 0.0, 0.1], 0.5), Box::new(capsule), Box::new(cuboid)]
}

fn combinations() -> Vec<Csg<f64>> {
    let sharp = [Operation::Union, Operation::Intersection, Operation::Subtraction];
    let smooth = Csg::smooth_union(0.5, children());
    sharp.map(|operation| Csg::new(operation, children())).into_iter().chain([smooth]).collect()
}

const POINTS: [DVec3; 4] = [
    DVec3::new(0.3, 0.4, -0.2),
    DVec3::new(-0.5, 0.1, 0.3),
    DVec3::new(0.9, -0.2, 0.1),
    DVec3::new(0.05, 0.15, 0.6),
];

/// Directions, one a point.
const DIRECTIONS: [DVec3; 4] = [
    DVec3::new(1.0, 0.5, -0.3),
    DVec3::new(-0.2, 0.7, 0.4),
    DVec3::new(0.1, -0.6, 0.9),
    DVec3::new(0.8, 0.2, 0.5),
];

#[test]
fn a_batch_is_its_points_one_by_one() {
    let alpha = [0.3, -0.7, 1.1, 0.4];
    for field in combinations() {
        let n = field.parameter_count();
        let (mut f, mut g, mut product) = ([0.0; 4], [DVec3::ZERO; 4], [DVec3::ZERO; 4]);
        let (mut adjoint, mut sum) = (vec![0.0; n], vec![0.0; n]);
        let mut face = [0; 4];
        field.value_gradient(&POINTS, &mut f, &mut g);
        field.faces(&POINTS, &mut face);
        field.parameter_vjp(&POINTS, &alpha, &DIRECTIONS, &mut adjoint);
        let mut again = [DVec3::ZERO; 4];
        field.hessian_vector(&POINTS, &DIRECTIONS, &mut again, &mut product);
        for i in 0..POINTS.len() {
            let (x, p) = ([POINTS[i]], [DIRECTIONS[i]]);
            let (mut one, mut gradient, mut hessian) = ([0.0], [DVec3::ZERO], [DVec3::ZERO]);
            field.value_gradient(&x, &mut one, &mut gradient);
            assert_eq!((f[i], g[i]), (one[0], gradient[0]));
            field.hessian_vector(&x, &p, &mut gradient, &mut hessian);
            assert_eq!((again[i], product[i]), (gradient[0], hessian[0]));
            let mut own = [0];
            field.faces(&x, &mut own);
            assert_eq!(face[i], own[0]);
            field.parameter_vjp(&x, &alpha[i..=i], &p, &mut sum);
        }
        for (all, sum) in adjoint.iter().zip(&sum) {
            assert_relative_eq!(all, sum, epsilon = 1e-12);
        }
    }
}

#[test]
fn bounds_follow_the_operation() {
    let two = || vec![ball([-1.0, 0.0, 0.0], 0.5), ball([1.0, 0.0, 0.0], 0.25)];
    let bounds = |field: Csg<f64>| field.bounds().map(|Sphere { center, radius }| (center, radius));
    // From −1.5 to 1.25 along x.
    let around = (DVec3::new(-0.125, 0.0, 0.0), 1.375);
    assert_eq!(bounds(Csg::new(Operation::Union, two())), Some(around));
    // Each of the two blends of three children adds a quarter of their width.
    let three = two().into_iter().chain([ball([0.0; 3], 0.1)]).collect();
    assert_eq!(bounds(Csg::smooth_union(0.4, three)), Some((around.0, 1.375 + 0.2)));
    let smaller = Some((DVec3::X, 0.25));
    assert_eq!(bounds(Csg::new(Operation::Intersection, two())), smaller);
    let reversed = two().into_iter().rev().collect();
    assert_eq!(bounds(Csg::new(Operation::Intersection, reversed)), smaller);
    // The first of two equal ones.
    let equal = vec![ball([-1.0, 0.0, 0.0], 0.5), ball([1.0, 0.0, 0.0], 0.5)];
    let first = Some((-DVec3::X, 0.5));
    assert_eq!(bounds(Csg::new(Operation::Intersection, equal)), first);
    assert_eq!(bounds(Csg::new(Operation::Subtraction, two())), first);
    let plane = || Box::new(Shape::new(Kind::Plane, &[0.0, 1.0, 0.0, 0.0])) as Box<dyn Field<f64>>;
    assert_eq!(bounds(Csg::new(Operation::Union, vec![plane(), ball([0.0; 3], 1.0)])), None);
    let cut = Csg::new(Operation::Intersection, vec![plane(), ball([0.0; 3], 1.0)]);
    assert_eq!(bounds(cut), Some((DVec3::ZERO, 1.0)));
}

/// A ball's distance times two: steeper than a distance.
struct Steep(Shape<f64>);

impl Field<f64> for Steep {
    fn parameter_count(&self) -> usize {
        self.0.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        self.0.bounds()
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        self.0.value(x, f);
        f.iter_mut().for_each(|f| *f *= 2.0);
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        self.0.value_gradient(x, f, gradient);
        f.iter_mut().for_each(|f| *f *= 2.0);
        gradient.iter_mut().for_each(|g| *g *= 2.0);
    }
    fn hessian_vector(&self, x: &[DVec3], p: &[DVec3], g: &mut [DVec3], product: &mut [DVec3]) {
        self.0.hessian_vector(x, p, g, product);
        g.iter_mut().chain(product).for_each(|g| *g *= 2.0);
    }
    fn parameter_vjp(&self, x: &[DVec3], alpha: &[f64], c: &[DVec3], adjoint: &mut [f64]) {
        let mut own = vec![0.0; adjoint.len()];
        self.0.parameter_vjp(x, alpha, c, &mut own);
        adjoint.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * 2.0);
    }
}

#[test]
fn a_combination_is_a_distance_bound_if_all_children_are() {
    let steep = || Box::new(Steep(Shape::sphere([0.0; 3], 0.5))) as Box<dyn Field<f64>>;
    assert!(!steep().is_lipschitz());
    assert!(
        Csg::new(Operation::Union, vec![ball([0.0; 3], 1.0), ball([1.0; 3], 1.0)]).is_lipschitz()
    );
    for children in [vec![ball([0.0; 3], 1.0), steep()], vec![steep(), ball([0.0; 3], 1.0)]] {
        assert!(!Csg::new(Operation::Union, children).is_lipschitz());
    }
}

#[test]
fn creases_come_from_sharp_combinations_and_from_children() {
    let one = || vec![ball([0.0; 3], 1.0)];
    let two = || vec![ball([0.0; 3], 1.0), ball([1.0; 3], 1.0)];
    assert!(!Csg::new(Operation::Union, one()).has_creases());
    assert!(Csg::new(Operation::Union, two()).has_creases());
    assert!(!Csg::smooth_union(0.1, two()).has_creases());
    let edged = Box::new(Shape::new(Kind::Box, &[0.0, 0.0, 0.0, 0.5, 0.5, 0.5]));
    assert!(Csg::smooth_union(0.1, vec![ball([0.0; 3], 1.0), edged]).has_creases());
}

#[test]
fn faces_are_those_of_the_child_that_gives_the_value() {
    // The two balls touch x = 0 from both sides, and are as far from every point of that plane.
    let balls = || vec![ball([-1.0, 0.0, 0.0], 1.25), ball([1.0, 0.0, 0.0], 1.25)];
    let (left, right) = (DVec3::new(-0.5, 1.0, 0.0), DVec3::new(0.5, 1.0, 0.0));
    let tie = DVec3::new(0.0, 1.0, 0.0);
    let faces = |field: &Csg<f64>, x: &[DVec3]| {
        let mut face = vec![0; x.len()];
        field.faces(x, &mut face);
        face
    };
    let x = [left, right, tie];
    let union = faces(&Csg::new(Operation::Union, balls()), &x);
    let intersection = faces(&Csg::new(Operation::Intersection, balls()), &x);
    assert_ne!(union[0], union[1]);
    assert_eq!(union[2], union[0], "the first of two equal ones");
    // The intersection has the surface of the ball further away.
    assert_eq!([intersection[1], intersection[0]], [union[0], union[1]]);
    assert_eq!(intersection[2], union[0]);
    // A ball inside the first one, subtracted: its own face near it, the outer one elsewhere.
    let shell = Csg::new(Operation::Subtraction, vec![ball([0.0; 3], 1.0), ball([0.0; 3], 0.5)]);
    let shell = faces(&shell, &[DVec3::X * 0.51, DVec3::X * 0.99, DVec3::X * 0.6]);
    assert_eq!(shell, [union[1], union[0], union[1]]);
    // In the joint of a smooth union both faces count: the values differ by less than 0.5 there.
    let smooth = Csg::smooth_union(0.5, balls());
    let near = DVec3::new(0.06, 1.0, 0.0);
    let smooth = faces(&smooth, &[near, -near + 2.0 * DVec3::Y, left, right]);
    assert_eq!(smooth[0], smooth[1]);
    assert_eq!([smooth[2], smooth[3]], [union[0], union[1]]);
    assert!(smooth[0] != smooth[2] && smooth[0] != smooth[3]);
}
