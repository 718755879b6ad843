use random::{Name, Stream};
use std::collections::HashMap;
use std::f64::consts::PI;

use approx::assert_relative_eq;
use field::{Csg, Evaluations, Field, Kind, Operation, Real, Scalar, Shape, Sphere};
use glam::{DVec3, Vec3};
use proptest::prelude::*;

use crate::{Components, Mesh, extract, extract_with};

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.2 };

fn torus<R: Real + Scalar<Real = R>>() -> Shape<R> {
    Shape::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.2, 1.0, 0.1, 0.7, 0.25])
}

/// Asserts a closed manifold that is oriented outwards and has unit normals.
fn assert_sound(mesh: &Mesh) {
    assert!(mesh.is_closed());
    assert!(mesh.volume() > 0.0);
    assert!(
        mesh.normals.len() == mesh.vertices.len() && mesh.normals.iter().all(|n| n.is_normalized())
    );
    assert!(has_one_fan_per_vertex(mesh), "the faces around a vertex are not one fan");
}

/// Whether the faces around each vertex of a closed mesh form one fan: a walk around the vertex,
/// from face to face, visits all of its corners.
fn has_one_fan_per_vertex(mesh: &Mesh) -> bool {
    let next: HashMap<(u32, u32), u32> = mesh
        .faces
        .iter()
        .flat_map(|[a, b, c]| [((*a, *b), *c), ((*b, *c), *a), ((*c, *a), *b)])
        .collect();
    let mut corners = vec![(0, 0); mesh.vertices.len()];
    for [a, b, c] in &mesh.faces {
        for (v, start) in [(*a, *b), (*b, *c), (*c, *a)] {
            corners[v as usize] = (corners[v as usize].0 + 1, start);
        }
    }
    corners.iter().enumerate().all(|(v, (count, start))| {
        let (mut at, mut visited) = (next[&(v as u32, *start)], 1);
        while at != *start && visited <= *count {
            (at, visited) = (next[&(v as u32, at)], visited + 1);
        }
        visited == *count
    })
}

#[test]
fn a_sphere_has_its_area_volume_and_genus() {
    let bounds = Sphere { center: DVec3::splat(0.1), radius: 1.0 };
    let mesh = extract(&Shape::<f64>::sphere([0.1; 3], 0.6), &bounds, 64, &|_| {});
    assert_sound(&mesh);
    assert_eq!(mesh.genus(), Some(0));
    assert_relative_eq!(mesh.area(), 4.0 * PI * 0.36, max_relative = 1e-3);
    assert_relative_eq!(mesh.volume(), 4.0 / 3.0 * PI * 0.216, max_relative = 2e-3);
    for (v, n) in mesh.vertices.iter().zip(&mesh.normals) {
        let v = *v - 0.1;
        assert!((v.length() - 0.6).abs() < 1e-6 && n.dot(v) > 0.599_99, "{v} {n}");
    }
}

#[test]
fn a_torus_has_genus_one_and_vertices_on_the_surface() {
    for mesh in [
        extract(&torus::<f32>(), &BOUNDS, 64, &|_| {}),
        extract(&torus::<f64>(), &BOUNDS, 64, &|_| {}),
    ] {
        assert_sound(&mesh);
        assert_eq!(mesh.genus(), Some(1));
        assert_relative_eq!(mesh.area(), 4.0 * PI.powi(2) * 0.7 * 0.25, max_relative = 5e-3);
        assert_relative_eq!(
            mesh.volume(),
            2.0 * PI.powi(2) * 0.7 * 0.25 * 0.25,
            max_relative = 1e-2
        );
        let x: Vec<DVec3> = mesh.vertices.iter().map(|v| v.as_dvec3()).collect();
        let mut f = vec![0.0; x.len()];
        torus::<f64>().value(&x, &mut f);
        let worst = f.iter().fold(0.0, |m: f64, f| m.max(f.abs()));
        assert!(worst < 1e-6, "a vertex is {worst} from the surface");
    }
}

#[test]
fn a_box_is_cut_off_at_its_edges_by_less_than_a_cell() {
    let cube = Shape::<f64>::new(Kind::Box, &[0.0, 0.1, 0.0, 0.5, 0.4, 0.3]);
    let mesh = extract(&cube, &BOUNDS, 128, &|_| {});
    assert_sound(&mesh);
    assert_eq!(mesh.genus(), Some(0));
    assert_relative_eq!(mesh.volume(), 8.0 * 0.06, max_relative = 2e-3);
    // The edges have the length 9.6 in all. The mesh cuts off half a cell on both sides of each.
    let cut = 9.6 * 0.5 * (2.4 / 128.0) * (2.0 - 2f64.sqrt());
    assert_relative_eq!(mesh.area(), 8.0 * (0.2 + 0.12 + 0.15) - cut, max_relative = 3e-3);
}

#[test]
fn a_solid_beyond_the_bounding_sphere_is_closed_by_the_sphere() {
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.0 };
    let half =
        extract(&Shape::<f32>::new(Kind::Plane, &[0.0, 0.0, 1.0, 0.0]), &bounds, 64, &|_| {});
    assert_sound(&half);
    assert_relative_eq!(half.volume(), 2.0 / 3.0 * PI, max_relative = 5e-3);
    // A field that is negative everywhere gives the whole bounding sphere.
    let all = extract(&Shape::<f64>::sphere([0.0; 3], 9.0), &bounds, 32, &|_| {});
    assert_sound(&all);
    assert_relative_eq!(all.area(), 4.0 * PI, max_relative = 5e-3);
    assert!(all.vertices.iter().all(|v| (v.length() - 1.0).abs() < 1e-6));
}

/// A torus, with f times a factor.
struct Steep(Shape<f64>, f64);

impl Field<f64> for Steep {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        self.0.bounds()
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        self.0.value(x, f);
        f.iter_mut().for_each(|f| *f *= self.1);
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], g: &mut [DVec3]) {
        self.0.value_gradient(x, f, g);
        f.iter_mut().for_each(|f| *f *= self.1);
        g.iter_mut().for_each(|g| *g *= self.1);
    }
    fn hessian_vector(&self, x: &[DVec3], p: &[DVec3], g: &mut [DVec3], h: &mut [DVec3]) {
        self.0.hessian_vector(x, p, g, h);
    }
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

#[test]
fn a_steep_or_flat_field_has_the_mesh_of_a_distance() {
    let mesh = |factor: f64| extract(&Steep(torus(), factor), &BOUNDS, 64, &|_| {});
    let distance = mesh(1.0);
    for factor in [0.2, 10.0] {
        let mesh = mesh(factor);
        assert_sound(&mesh);
        assert_relative_eq!(mesh.volume(), distance.volume(), max_relative = 1e-3);
        assert_eq!(mesh.faces.len(), distance.faces.len());
    }
}

#[test]
fn a_cavity_is_a_component_with_negative_volume_and_dropped_unless_asked_for() {
    let shell = Csg::new(
        Operation::Subtraction,
        vec![
            Box::new(Shape::<f64>::sphere([0.0; 3], 1.0)),
            Box::new(Shape::sphere([0.1, 0.0, 0.0], 0.5)),
        ],
    );
    let mesh = extract_with(&shell, &BOUNDS, 64, Components::All, &|_| {});
    assert!(mesh.is_closed());
    assert_eq!((mesh.components(), mesh.euler_characteristic(), mesh.genus()), (2, 4, None));
    assert_relative_eq!(mesh.volume(), 4.0 / 3.0 * PI * (1.0 - 0.125), max_relative = 3e-3);
    let outer = extract(&shell, &BOUNDS, 64, &|_| {});
    assert!(outer.is_closed() && outer.components() == 1);
    assert_relative_eq!(outer.volume(), 4.0 / 3.0 * PI, max_relative = 3e-3);
}

#[test]
fn the_chosen_components_are_kept() {
    let balls = [([-0.5, 0.0, 0.0], 0.5), ([0.6, 0.0, 0.0], 0.25), ([0.0, 0.8, 0.0], 0.04)];
    let union: Vec<Box<dyn Field<f64>>> = balls
        .iter()
        .map(|(c, r)| Box::new(Shape::<f64>::sphere(*c, *r)) as Box<dyn Field<f64>>)
        .collect();
    let union = Csg::new(Operation::Union, union);
    let count = |keep| extract_with(&union, &BOUNDS, 96, keep, &|_| {}).components();
    assert_eq!(count(Components::All), 3);
    assert_eq!(count(Components::default()), 2);
    assert_eq!(count(Components::AtLeast(0.3)), 1);
    assert_eq!(count(Components::Largest), 1);
    let largest = extract_with(&union, &BOUNDS, 96, Components::Largest, &|_| {});
    assert!(largest.vertices.iter().all(|v| v.x < 0.01));
}

/// A field from a formula for its value, without parameters; the gradient is by differences.
struct Formula<F>(F);

impl<F: Fn(DVec3) -> f64 + Send + Sync> Field<f64> for Formula<F> {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        None
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        x.iter().zip(f).for_each(|(x, f)| *f = (self.0)(*x));
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        self.value(x, f);
        let h = 1e-5;
        let along = |x: DVec3, e: DVec3| ((self.0)(x + h * e) - (self.0)(x - h * e)) / (2.0 * h);
        x.iter().zip(gradient).for_each(|(x, g)| *g = DVec3::AXES.map(|e| along(*x, e)).into());
    }
    fn hessian_vector(&self, _: &[DVec3], _: &[DVec3], _: &mut [DVec3], _: &mut [DVec3]) {}
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

/// Independent signs at the points of a lattice that is finer than the grid, so that every
/// combination of signs in a cell occurs. `density` is the share of points inside.
fn noise(seed: u64, density: f64) -> Formula<impl Fn(DVec3) -> f64 + Send + Sync> {
    Formula(move |x: DVec3| {
        let stream = Stream::of_seed(seed).named(Name::other("solid cells"));
        let point = (x * 97.0).round().to_array();
        let stream = point.iter().fold(stream, |stream, c| stream.at(c.to_bits()));
        1e-3 * (stream.unit() - density)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_surface_of_noise_is_closed_and_a_manifold(
        seed in any::<u64>(),
        density in 0.05..0.95f64,
    ) {
        let mesh = extract_with(&noise(seed, density), &BOUNDS, 14, Components::All, &|_| {});
        prop_assert!(mesh.is_closed());
        prop_assert!(has_one_fan_per_vertex(&mesh));
        prop_assert_eq!(mesh.euler_characteristic() % 2, 0);
    }
}

#[test]
fn skipped_blocks_do_not_change_the_mesh() {
    let counted = field::Counted::new(torus::<f64>());
    let sparse = extract(&counted, &BOUNDS, 100, &|_| {});
    // The same surface from a field that is so flat that no block is skipped.
    let flat = Formula(|x: DVec3| {
        let mut f = [0.0];
        torus::<f64>().value(&[x], &mut f);
        1e-3 * f[0]
    });
    let dense = extract(&flat, &BOUNDS, 100, &|_| {});
    assert_eq!(sparse.faces.len(), dense.faces.len());
    assert_relative_eq!(sparse.volume(), dense.volume(), max_relative = 1e-6);
    let Evaluations { value, .. } = counted.evaluations();
    assert!(value < 104usize.pow(3) as u64 / 6, "{value} points were evaluated");
}

#[test]
fn the_number_of_threads_does_not_matter_and_progress_ends_at_one() {
    let extract_on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let last = std::sync::Mutex::new(0.0f64);
        let progress = |p: f64| {
            let mut last = last.lock().unwrap();
            *last = last.max(p);
        };
        let mesh = pool.install(|| extract(&torus::<f32>(), &BOUNDS, 48, &progress));
        assert_eq!(*last.lock().unwrap(), 1.0);
        mesh
    };
    assert_eq!(extract_on(1), extract_on(3));
}

#[test]
fn values_that_are_not_finite_give_a_closed_mesh_or_none() {
    let of_constant = |f: f64| extract(&Formula(move |_| f), &BOUNDS, 20, &|_| {});
    for f in [f64::NAN, f64::INFINITY, 1e30, 1e-300, 0.0] {
        assert!(of_constant(f).faces.is_empty(), "{f}");
    }
    for f in [f64::NEG_INFINITY, -1e30, -1.0] {
        assert_sound(&of_constant(f));
    }
    let holes = Formula(|x: DVec3| if x.x > 0.1 { f64::NAN } else { x.length() - 0.8 });
    assert_sound(&extract(&holes, &BOUNDS, 40, &|_| {}));
    let infinite = Formula(|x: DVec3| if x.x > 0.1 { f64::INFINITY } else { x.length() - 0.8 });
    assert_sound(&extract(&infinite, &BOUNDS, 40, &|_| {}));
    let steep = Formula(|x: DVec3| 1e30 * (x.length() - 0.8));
    assert!(extract(&steep, &BOUNDS, 40, &|_| {}).is_closed());
    for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let bounds = Sphere { center: DVec3::ZERO, radius };
        assert_eq!(extract(&torus::<f64>(), &bounds, 20, &|_| {}), Mesh::default());
    }
    assert!(extract(&Shape::<f64>::sphere([0.0; 3], 1.0), &BOUNDS, 0, &|_| {}).is_closed());
}

#[test]
fn unused_vertices_do_not_count() {
    let mut mesh = extract(&Shape::<f64>::sphere([0.0; 3], 1.0), &BOUNDS, 16, &|_| {});
    mesh.vertices.push(Vec3::X);
    assert_eq!((mesh.genus(), mesh.components()), (Some(0), 1));
    mesh.faces.pop();
    assert!(!mesh.is_closed() && mesh.genus().is_none());
    assert!(!Mesh::default().is_closed());
}

/// The mesh as a reader sees it that merges vertices at equal positions in single precision.
fn merged(mesh: &Mesh) -> Mesh {
    let mut index = HashMap::new();
    let mut out = Mesh::default();
    let mut merge = |v: &u32| {
        let position = mesh.vertices[*v as usize];
        *index.entry(position.to_array().map(f32::to_bits)).or_insert_with(|| {
            out.vertices.push(position);
            out.vertices.len() as u32 - 1
        })
    };
    let faces = mesh.faces.iter().map(|f| [merge(&f[0]), merge(&f[1]), merge(&f[2])]).collect();
    Mesh { faces, ..out }
}

/// Asserts that merging equal positions, also of a mesh that is scaled, changes nothing.
fn assert_distinct(mesh: &Mesh) {
    for scale in [1.0, 1.01, 0.001, 39.37] {
        let vertices = mesh.vertices.iter().map(|v| (v.as_dvec3() * scale).as_vec3()).collect();
        let merged = merged(&Mesh { vertices, faces: mesh.faces.clone(), ..Mesh::default() });
        assert_eq!(merged.vertices.len(), mesh.vertices.len(), "scale {scale}");
        assert!(merged.is_closed() && has_one_fan_per_vertex(&merged));
        assert_eq!(merged.euler_characteristic(), mesh.euler_characteristic());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_two_vertices_of_noise_are_at_one_place(seed in any::<u64>(), density in 0.05..0.95f64) {
        let mesh = extract_with(&noise(seed, density), &BOUNDS, 14, Components::All, &|_| {});
        assert_distinct(&mesh);
    }

    /// Thin walls and solids that touch: surface nets have several sheets in a cell.
    #[test]
    fn no_two_vertices_of_thin_solids_are_at_one_place(
        a in prop::array::uniform3(-0.5..0.5f64),
        radius in 0.2..0.6f64,
        wall in 0.002..0.05f64,
        resolution in 12usize..48,
    ) {
        let shell = |x: DVec3, c: DVec3, r: f64| ((x - c).length() - r).abs() - wall;
        let solid = Formula(move |x: DVec3| {
            let a = DVec3::from(a);
            shell(x, a, radius).min(shell(x, -a, radius)).min((x.x - x.z).abs() - wall)
        });
        let mesh = extract_with(&solid, &BOUNDS, resolution, Components::All, &|_| {});
        if !mesh.faces.is_empty() {
            assert_distinct(&mesh);
        }
    }
}

/// Without the last step, vertices of these meshes coincide.
#[test]
fn separate_cells_of_a_chequerboard_touch_at_their_edges() {
    let board = Formula(|x: DVec3| {
        let cell = (x * 5.0).floor();
        if (cell.x + cell.y + cell.z).rem_euclid(2.0) < 1.0 { -0.05 } else { 0.05 }
    });
    let mesh = extract_with(&board, &BOUNDS, 24, Components::All, &|_| {});
    assert!(mesh.faces.len() > 1000);
    assert_distinct(&mesh);
}
