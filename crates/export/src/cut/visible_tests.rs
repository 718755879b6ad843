//! Visible and masked parts of spheres, in closed form.

use dataset::{Mask, MaskKind, View};
use field::UniformBackground;
use field::{Csg, Field, Operation, Shape, Sphere};
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use mesh::{Mesh, extract};
use render::{Analytic, Camera, Formula, Scene, render};

use crate::cut::{Cutter, inside_masks, seen_vertices, vertices_with_normals};

const UNIT: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

/// Grid cells of the meshes.
const CELLS: usize = 128;

/// A camera at `eye` that sees the unit sphere whole.
fn camera(eye: DVec3) -> Camera {
    let (focal, middle) = (DVec2::splat(180.0), DVec2::splat(60.0));
    let up = DVec3::new(0.1, 0.2, 1.0);
    Camera::look_at(120, 120, focal, middle, eye, DVec3::ZERO, up).unwrap()
}

fn views(eyes: &[DVec3]) -> Vec<View> {
    let view = |eye: &DVec3| View {
        name: String::new(),
        path: "0.png".into(),
        camera: camera(*eye),
        image: Film::new(120, 120),
        mask: None,
    };
    eyes.iter().map(view).collect()
}

/// Calls `then` with the scene of a field before these views.
fn with_scene<T>(
    field: &dyn Field<f32>,
    views: &[View],
    then: impl FnOnce(&Scene<'_, f32>) -> T,
) -> T {
    let shader = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let background = UniformBackground(Vec3::ZERO);
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    then(&Scene::new(field, &shader, &cameras, &UNIT, &background))
}

/// The flags of the mesh's vertices that the views see.
fn seen(field: &dyn Field<f32>, mesh: &Mesh, views: &[View]) -> Vec<bool> {
    let points = vertices_with_normals(mesh);
    let cell = 2.0 / CELLS as f64;
    let found = with_scene(field, views, |scene| {
        seen_vertices(scene, 0..views.len(), views, &points, cell, &|_| {})
    });
    found.unwrap()
}

#[test]
fn two_cameras_see_two_caps_of_a_sphere() {
    let ball = Shape::<f32>::sphere([0.0; 3], 0.5);
    let mesh = extract(&ball, &UNIT, CELLS, &|_| {});
    let eyes = [DVec3::new(4.0, 0.0, 0.0), DVec3::new(-1.0, -3.0, 0.5)];
    let views = views(&eyes);
    let flags = seen(&ball, &mesh, &views);
    // A convex surface hides a point only by the point's own side: by brute force, for each
    // vertex. Vertices are off the sphere by up to 1e-4, which counts near the caps' edges.
    let mut undecided = 0;
    for (flag, v) in flags.iter().zip(&mesh.vertices) {
        let n = v.as_dvec3().normalize();
        let cosines = eyes.map(|eye| n.dot((eye - 0.5 * n).normalize()));
        let most = cosines[0].max(cosines[1]);
        undecided += usize::from(most.abs() < 0.01);
        assert!(most.abs() < 0.01 || *flag == (most > 0.0), "{v} is {flag}, cosine {most}");
    }
    assert!(undecided * 50 < flags.len(), "{undecided}");
    // One camera at distance d sees the part (1 − r/d)/2 of the sphere.
    for (number, eye) in eyes.iter().enumerate() {
        let flags = seen(&ball, &mesh, &views[number..=number]);
        let mut cutter = Cutter::new(&mesh);
        let step = cutter.keep_touching(&flags);
        let expected = 0.5 * (1.0 - 0.5 / eye.length());
        // Faces that touch the edge stay: up to a cell around the cap.
        let (left, ring) = (1.0 - step.area, 2.0 / CELLS as f64);
        assert!((0.0..1.1 * ring).contains(&(left - expected)), "{left} and {expected}");
        let rest = cutter.mesh();
        assert_eq!(rest.faces.len() + step.faces, mesh.faces.len());
        assert!((rest.area() / mesh.area() - left).abs() < 1e-12);
    }
}

#[test]
fn a_ball_hides_another_and_left_out_pixels_see_nothing() {
    let ball = |x: f64, radius: f64| -> Box<dyn Field<f32>> {
        Box::new(Shape::sphere([x, 0.0, 0.0], radius))
    };
    let two = Csg::new(Operation::Union, vec![ball(0.4, 0.3), ball(-0.4, 0.2)]);
    let mesh = extract(&two, &UNIT, CELLS, &|_| {});
    let mut views = views(&[DVec3::X * 4.0]);
    let flags = seen(&two, &mesh, &views);
    let behind = |v: &Vec3| v.x < 0.0;
    assert!(flags.iter().zip(&mesh.vertices).all(|(flag, v)| !(*flag && behind(v))));
    assert!(flags.iter().any(|flag| *flag));
    // From the other side the small ball is seen, and the rim of the large one around it.
    let back = self::views(&[DVec3::X * -4.0]);
    let flags = seen(&two, &mesh, &back);
    let counts = [true, false].map(|small| {
        flags.iter().zip(&mesh.vertices).filter(|(f, v)| **f && behind(v) == small).count()
    });
    assert!(counts.iter().all(|count| *count > 100), "{counts:?}");
    // Without the left half of the film, the camera sees half.
    let values = (0..120 * 120).map(|i| f32::from(u8::from(i % 120 >= 60))).collect();
    views[0].mask = Some(Mask { kind: MaskKind::Used, values });
    let right = views[0].camera.right;
    let flags = seen(&two, &mesh, &views);
    assert!(flags.iter().zip(&mesh.vertices).all(|(f, v)| !*f || v.as_dvec3().dot(right) > -1e-6));
    assert!(flags.iter().any(|flag| *flag));
}

#[test]
fn masks_of_a_rendered_sphere_cut_the_surface_around_it() {
    // The masks are those of the ball alone; the surface has another ball beside it.
    let ball = Shape::<f32>::sphere([0.0; 3], 0.4);
    let eyes = [DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0), DVec3::new(1.0, 1.0, 3.8)];
    let mut views = views(&eyes);
    let masks = with_scene(&ball, &views, |scene| {
        [0, 1, 2].map(|camera| render(scene, camera, 4, 0, &|_| {}).unwrap().coverage)
    });
    for (view, values) in views.iter_mut().zip(masks) {
        view.mask = Some(Mask { kind: MaskKind::Object, values });
    }
    let parts: Vec<Box<dyn Field<f32>>> =
        vec![Box::new(ball), Box::new(Shape::sphere([0.0, 0.75, 0.1], 0.2))];
    let mesh = extract(&Csg::new(Operation::Union, parts), &UNIT, CELLS, &|_| {});
    let points: Vec<DVec3> = mesh.vertices.iter().map(|v| v.as_dvec3()).collect();
    let is_first = |x: &DVec3| x.length() < 0.45;
    // A film of 120 pixels: a margin of three pixels.
    let inside = inside_masks(&views, &points, 3.0 / 120.0).unwrap();
    assert!(points.iter().zip(&inside).all(|(x, inside)| *inside == is_first(x)));
    // A large margin keeps all but the far end of the other ball. A point of it is kept if the
    // angle between its ray and that to the centre is small enough, in each view.
    let inside = inside_masks(&views, &points, 15.0 / 120.0).unwrap();
    for (x, inside) in points.iter().zip(&inside) {
        let pixels = views.iter().map(|view| {
            let distance = view.camera.project(*x).unwrap().distance(DVec2::splat(60.0));
            // The outline of the ball is a circle around the film's centre.
            let outline = 180.0 * 0.4 / (view.camera.eye.length_squared() - 0.16).sqrt();
            distance - outline
        });
        let most = pixels.fold(f64::NEG_INFINITY, f64::max);
        assert!((most - 15.0).abs() < 1.5 || *inside == (most < 15.0), "{x}: {most}");
    }
    let kept = inside.iter().filter(|inside| **inside).count();
    assert!(kept < points.len() && kept > points.iter().filter(|x| is_first(x)).count());
}
