//! Solids that several tests trace.

use field::{Csg, Field, Kind, Operation, Shape};

/// Solids with their names.
pub(crate) fn solids() -> Vec<(&'static str, Box<dyn Field<f64>>)> {
    let torus =
        || Box::new(Shape::<f64>::new(Kind::Torus, &[0.0, 0.1, 0.0, 0.3, 1.0, 0.2, 0.8, 0.25]));
    let capsule =
        || Box::new(Shape::<f64>::new(Kind::Capsule, &[-0.8, 0.0, 0.2, 0.7, 0.4, -0.3, 0.2]));
    let cube = || Box::new(Shape::<f64>::new(Kind::Box, &[0.1, 0.0, 0.0, 0.6, 0.5, 0.4]));
    vec![
        ("ball", Box::new(Shape::sphere([0.1, 0.0, -0.2], 0.7))),
        ("torus", torus()),
        ("capsule", capsule()),
        ("cube", cube()),
        ("union", Box::new(Csg::new(Operation::Union, vec![torus(), capsule()]))),
        ("subtraction", Box::new(Csg::new(Operation::Subtraction, vec![cube(), capsule()]))),
        ("smooth union", Box::new(Csg::smooth_union(0.3, vec![torus(), capsule()]))),
    ]
}
