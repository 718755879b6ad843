//! The sphere by matches between photographs of a ball on a wall, all from the front.

use dataset::{Dataset, View};
use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;

use crate::cloud::before_plane;
use crate::{SphereSource, Surroundings, surroundings};

/// Half of it stands out of the wall, the plane z = 0.
const BALL: Sphere<f64> = Sphere { center: DVec3::new(0.1, 0.0, 0.0), radius: 0.5 };

/// Radiances of a point, with a pattern in all directions.
fn pattern(x: DVec3) -> [f32; 3] {
    let wave = |a: f64, b: f64, c: f64| (a * x.x + 2.0 * (b * x.y).sin() + c * x.z).sin();
    let sum = wave(23.0, 9.0, 11.0) * wave(-5.0, 31.0, 17.0) + 0.5 * wave(41.0, 37.0, -13.0);
    [0.4 + 0.2 * sum as f32; 3]
}

/// The photographs of 16 cameras at the distance 4 in front of the wall, which aim at a point
/// `behind` it.
fn on_wall(origin: DVec3, unit: f64, behind: f64) -> Dataset {
    let view = |i: i32| {
        let place = DVec3::new(f64::from(i % 4) - 1.5, f64::from(i / 4) - 1.5, 0.0) * 0.5;
        let (eye, target) = (place + DVec3::Z * 4.0, DVec3::Z * -behind);
        let (focal, middle) = (DVec2::splat(160.0), DVec2::new(48.0, 40.0));
        let camera = Camera::look_at(96, 80, focal, middle, eye, target, DVec3::Y).unwrap();
        let mut image = Film::new(96, 80);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let d = camera.direction(DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5));
            let wall = -eye.z / d.z;
            let t = BALL.clip(eye, d).map_or(wall, |(near, _)| near.min(wall));
            *pixel = pattern(eye + d * t);
        }
        let camera = Camera { eye: origin + unit * eye, ..camera };
        View { name: String::new(), path: Default::default(), camera, image, mask: None }
    };
    Dataset {
        path: "wall".into(),
        format: "test".to_owned(),
        train: (0..16).map(view).collect(),
        test: Vec::new(),
        bounds: None,
        points: Vec::new(),
        is_sure: Vec::new(),
        notes: Vec::new(),
    }
}

/// Whether a sphere holds the ball, and hardly more than the films show: 1.9 of its radii at the
/// wall. `unit` is that of the data set.
fn holds(sphere: &Sphere<f64>, origin: DVec3, unit: f64) -> bool {
    let (center, radius) = ((sphere.center - origin) / unit, sphere.radius / unit);
    center.distance(BALL.center) + BALL.radius < radius && radius < 2.4 * BALL.radius
}

#[test]
fn photographs_of_one_side_give_a_sphere_around_what_they_show() {
    let (origin, unit) = (DVec3::new(7e5, -2e4, 30.0), 12.0);
    let dataset = on_wall(origin, unit, 3.0);
    let cameras = surroundings(&dataset, None, false);
    assert_eq!(cameras.source, SphereSource::Cameras);
    assert!(!holds(&cameras.sphere, origin, unit), "{:?}", cameras.sphere);
    let found = cameras.with_matches(&dataset);
    assert_eq!(found.source, SphereSource::Matches);
    assert!(holds(&found.sphere, origin, unit), "{:?}", found.sphere);
    let off = |x: &DVec3| {
        let x = (*x - origin) / unit;
        x.z.abs().min((x.distance(BALL.center) - BALL.radius).abs())
    };
    let mut all: Vec<f64> = found.points.iter().map(off).collect();
    all.sort_by(f64::total_cmp);
    let [middle, most] = [all[all.len() / 2], all[9 * all.len() / 10]];
    // A pixel is 0.025 wide at the wall.
    assert!(all.len() > 10_000 && middle < 0.025 && most < 0.1, "{middle}, {most}");
}

#[test]
fn depths_of_some_photographs_count_as_much_as_axes_of_all() {
    let mut dataset = on_wall(DVec3::ZERO, 1.0, 3.0);
    let few = surroundings(&dataset, None, false).with_matches(&dataset).sphere;
    let all = dataset.train.clone();
    for _ in 0..7 {
        dataset.train.extend(all.iter().cloned());
    }
    let many = surroundings(&dataset, None, false).with_matches(&dataset).sphere;
    assert!(many.center.distance(few.center) < 0.05, "{few:?} {many:?}");
}

#[test]
fn photographs_of_any_size_and_shifted_films_have_a_sphere() {
    let dataset = on_wall(DVec3::ZERO, 1.0, 3.0);
    let expected = surroundings(&dataset, None, false).with_matches(&dataset).sphere;
    // The same pixels beside others: twice as wide, with the principal point of before.
    let mut wide = dataset.clone();
    for view in &mut wide.train {
        view.camera.width = 2 * 96;
        let rows = view.image.pixels.chunks(96);
        view.image.pixels = rows.flat_map(|row| [row, &[[0.4; 3]; 96]].concat()).collect();
        view.image.width = 2 * 96;
    }
    let found = surroundings(&wide, None, false).with_matches(&wide).sphere;
    assert!(found.center.z.abs() < 0.6, "{expected:?} {found:?}");
    for side in [1, 2, 3] {
        let mut tiny = dataset.clone();
        for view in &mut tiny.train {
            view.camera = view.camera.resized(side, side);
            view.image = Film::grey(side, side, (0..side * side).map(|i| i as f32 * 0.1));
        }
        let _ = surroundings(&tiny, None, false).with_matches(&tiny);
    }
}

#[test]
fn parallel_axes_have_a_sphere_at_the_depth_of_the_surface() {
    let mut dataset = on_wall(DVec3::ZERO, 1.0, 1e9);
    let found = surroundings(&dataset, None, false).with_matches(&dataset);
    assert!(holds(&found.sphere, DVec3::ZERO, 1.0), "{:?}", found.sphere);
    // Photographs without a pattern leave the sphere as it is, and so does one photograph.
    for view in &mut dataset.train {
        view.image.pixels.fill([0.5; 3]);
    }
    let without = |dataset: &Dataset| {
        let cameras = surroundings(dataset, None, false);
        let known = Surroundings { source: SphereSource::Cameras, ..cameras };
        assert_eq!(known.clone().with_matches(dataset), known);
    };
    without(&dataset);
    dataset.train.truncate(1);
    without(&dataset);
}

#[test]
fn points_stand_out_of_a_plane_towards_the_cameras() {
    let grid = |height: f64, side: i32| {
        let place = move |i: i32| f64::from(i) / f64::from(side) - 0.5;
        (0..side * side).map(move |i| DVec3::new(place(i % side), height, place(i / side)))
    };
    let eye = DVec3::new(0.3, 5.0, 0.2);
    let (table, box_lid, below) = (grid(0.0, 30), grid(0.2, 12), grid(-0.2, 12));
    let all: Vec<DVec3> = table.clone().chain(box_lid.clone()).chain(below).collect();
    assert_eq!(before_plane(&all, eye, 1.0), Some(box_lid.collect()));
    // Nothing stands out of it; no plane.
    assert_eq!(before_plane(&table.collect::<Vec<_>>(), eye, 1.0), None);
    let ball: Vec<DVec3> = (0..900).map(|i| field::fibonacci_direction(i, 900, 0.0)).collect();
    assert_eq!(before_plane(&ball, eye, 1.0), None);
}
