use super::*;
use approx::assert_relative_eq;
use field::{Field, Kind, Shape, Sphere};
use proptest::prelude::*;

fn ball(radius: f64) -> Mesh {
    let bounds = Sphere { center: DVec3::splat(0.1), radius: 1.0 };
    extract(&Shape::<f32>::sphere([0.1; 3], radius), &bounds, 64, &|_| {})
}

#[test]
fn a_sphere_has_its_area_volume_and_genus() {
    let mesh = ball(0.6);
    assert!(mesh.is_closed());
    assert_eq!(mesh.genus(), Some(0));
    assert_relative_eq!(mesh.area(), 4.0 * std::f64::consts::PI * 0.36, max_relative = 5e-3);
    assert_relative_eq!(mesh.volume(), 4.0 / 3.0 * std::f64::consts::PI * 0.216, max_relative = 5e-3);
    let (v, n) = (mesh.vertices[7] - 0.1, mesh.normals[7]);
    assert_relative_eq!(v.length(), 0.6, epsilon = 1e-5);
    assert!(n.dot(v) > 0.599);
}

#[test]
fn a_torus_has_a_hole_and_a_box_its_edges() {
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.2 };
    let torus = Shape::<f32>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.2, 1.0, 0.1, 0.7, 0.25]);
    let mesh = extract(&torus, &bounds, 64, &|_| {});
    assert!(mesh.is_closed());
    assert_eq!(mesh.genus(), Some(1));
    assert_relative_eq!(mesh.area(), 4.0 * std::f64::consts::PI.powi(2) * 0.7 * 0.25, max_relative = 1e-2);
    let cube = Shape::<f32>::new(Kind::Box, &[0.0, 0.1, 0.0, 0.5, 0.4, 0.3]);
    let mesh = extract(&cube, &bounds, 64, &|_| {});
    assert!(mesh.is_closed());
    assert_relative_eq!(mesh.volume(), 8.0 * 0.06, max_relative = 2e-2);
}

#[test]
fn a_solid_that_leaves_the_ball_is_closed_by_it() {
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.0 };
    let half = extract(&Shape::<f32>::new(Kind::Plane, &[0.0, 0.0, 1.0, 0.0]), &bounds, 64, &|_| {});
    assert!(half.is_closed());
    assert_relative_eq!(half.volume(), 2.0 / 3.0 * std::f64::consts::PI, max_relative = 1e-2);
}

#[test]
fn vertices_lie_on_the_surface() {
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.2 };
    let torus = Shape::<f32>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.2, 1.0, 0.1, 0.7, 0.25]);
    let mesh = extract(&torus, &bounds, 64, &|_| {});
    let mut f = vec![0.0; mesh.vertices.len()];
    torus.value(&mesh.vertices, &mut f);
    assert!(f.iter().all(|f| f.abs() < 1e-5), "{:?}", f.iter().fold(0.0f32, |m, f| m.max(f.abs())));
}

#[test]
fn files_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = ball(0.5);
    for name in ["a.ply", "a.obj"] {
        let path = folder.path().join(name);
        write_mesh(&path, &mesh).unwrap();
        let again = read_mesh(&path).unwrap();
        assert_eq!((&again.vertices, &again.faces), (&mesh.vertices, &mesh.faces), "{name}");
    }
    let glb = folder.path().join("a.glb");
    write_mesh(&glb, &mesh).unwrap();
    let bytes = std::fs::read(&glb).unwrap();
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize, bytes.len());
    assert!(write_mesh(&folder.path().join("a.stl"), &mesh).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn damaged_files_never_panic(at in 0usize..2000, byte in any::<u8>(), cut in 0usize..2000) {
        let folder = tempfile::tempdir().unwrap();
        let triangle = Mesh { vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y], normals: vec![], faces: vec![[0, 1, 2]] };
        for name in ["a.ply", "a.obj"] {
            let path = folder.path().join(name);
            write_mesh(&path, &triangle).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let mut damaged = bytes.clone();
            damaged[at % bytes.len()] = byte;
            std::fs::write(&path, &damaged[..]).unwrap();
            let _ = read_mesh(&path);
            std::fs::write(&path, &bytes[..cut % bytes.len()]).unwrap();
            let _ = read_mesh(&path);
        }
    }
}

#[test]
fn impossible_meshes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    for (text, field) in [("v 0 0 0\nv 1 0 0\nv nan 0 0\nf 1 2 3\n", ""), ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "faces")] {
        std::fs::write(&path, text).unwrap();
        let error = read_mesh(&path).unwrap_err();
        assert!(error.field.contains(field), "{error}");
    }
    assert!(read_mesh(&folder.path().join("none.ply")).is_err());
}
