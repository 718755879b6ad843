//! The bounding sphere, the background, and the check of the cameras.

use approx::assert_relative_eq;
use dataset::{Dataset, Mask, MaskKind};
use field::Sphere;
use glam::{DVec2, DVec3};

use crate::test_ball::{BACKGROUND, ball, cameras, photographed};
use crate::{SphereSource, Surroundings, check_cameras, check_places, inspect, surroundings};

#[test]
fn cameras_inside_the_sphere_or_looking_away_are_refused() {
    let dataset = photographed(&cameras(9));
    assert!(check_cameras(&dataset, &ball()).is_ok());
    let check_turned = |count: usize| {
        let mut turned = dataset.clone();
        for view in turned.train.iter_mut().take(count) {
            // The pose read in the OpenCV convention: y down, z forward.
            view.camera.up = -view.camera.up;
            view.camera.forward = -view.camera.forward;
        }
        check_cameras(&turned, &ball())
    };
    assert!(check_turned(4).is_ok());
    let error = check_turned(7).unwrap_err().to_string();
    assert!(error.contains("7 of 9 cameras look away") && error.contains("OpenCV"), "{error}");
    let error = check_cameras(&dataset, &ball().scaled(7.0)).unwrap_err().to_string();
    assert!(error.contains("3.0000 from the centre") && error.contains("--bounds"), "{error}");
}

#[test]
fn the_estimated_sphere_contains_the_ball() {
    let dataset = photographed(&cameras(12));
    let Surroundings { sphere: bounds, background, .. } = surroundings(&dataset, None, false);
    let off = (bounds.center - ball().center).length();
    assert!(
        off + ball().radius < bounds.radius && bounds.radius < 1.35 * ball().radius,
        "{bounds:?}"
    );
    assert!(background.confidence > 0.9, "{background:?}");
    for (found, expected) in background.color.into_iter().zip(BACKGROUND) {
        assert_relative_eq!(found, expected, epsilon = 0.005);
    }
    // A given sphere is used unchanged.
    assert_eq!(surroundings(&dataset, Some(ball()), false).sphere, ball());
}

#[test]
fn cameras_at_one_place_are_refused() {
    let mut dataset = photographed(&cameras(9));
    assert!(check_places(&dataset).is_ok());
    let eye = dataset.train[0].camera.eye;
    dataset.train.iter_mut().chain(&mut dataset.test).for_each(|view| view.camera.eye = eye);
    let error = check_places(&dataset).unwrap_err().to_string();
    assert!(error.contains("9 cameras at one place"), "{error}");
}

#[test]
fn points_give_the_sphere_if_the_background_is_clutter() {
    let mut dataset = in_clutter();
    dataset.points = points_on(ball(), 100);
    let Surroundings { sphere: bounds, background, source, .. } =
        surroundings(&dataset, None, false);
    assert_eq!(source, SphereSource::Points);
    assert!(background.confidence < 0.3, "{background:?}");
    assert!((bounds.center - ball().center).length() < 0.1, "{bounds:?}");
    assert!((1.0..1.3).contains(&(bounds.radius / ball().radius)), "{bounds:?}");
}

/// The photographs of twelve cameras changed by `paint`, which gets the view's
/// number and whether the pixel shows the ball.
fn painted(paint: impl Fn(usize, bool, &mut [f32; 3])) -> Dataset {
    let mut dataset = photographed(&cameras(12));
    for (number, view) in dataset.train.iter_mut().enumerate() {
        let empty = view.image.at(0, 0);
        view.image.pixels.iter_mut().for_each(|p| paint(number, *p != empty, p));
    }
    dataset
}

fn holds_the_ball(sphere: &Sphere<f64>) -> bool {
    let off = (sphere.center - ball().center).length();
    off + ball().radius < sphere.radius && sphere.radius < 1.35 * ball().radius
}

#[test]
fn uniform_backgrounds_of_different_colours_give_the_sphere() {
    let dataset = painted(|number, is_ball, p| {
        if !is_ball {
            *p = [0.02; 3];
            p[number % 3] = 0.7;
        }
    });
    let found = surroundings(&dataset, None, false);
    assert!(found.is_per_view() && !found.is_common());
    assert_eq!(found.source, SphereSource::Outlines);
    assert!(holds_the_ball(&found.sphere), "{:?}", found.sphere);
}

#[test]
fn clutter_gives_the_sphere_of_the_masks_or_of_the_cameras() {
    let hash = |number: usize, p: &[f32; 3]| (p[0] * 1e4) as usize * 31 + number * 17;
    let mut dataset = painted(|_, _, _| {});
    for (number, view) in dataset.train.iter_mut().enumerate() {
        let empty = view.image.at(0, 0);
        let values = view.image.pixels.iter().map(|p| f32::from(u8::from(*p != empty))).collect();
        view.mask = Some(Mask { kind: MaskKind::Object, values });
        for (i, p) in view.image.pixels.iter_mut().enumerate() {
            *p = [7, 11, 5].map(|n| ((i + hash(number, p)) % n) as f32 / n as f32);
        }
    }
    let found = surroundings(&dataset, None, true);
    assert_eq!(found.source, SphereSource::Masks);
    assert!(holds_the_ball(&found.sphere), "{:?}", found.sphere);
    assert_eq!(surroundings(&dataset, None, false).source, SphereSource::Cameras);
    // Masks of pixels to leave out say nothing about the object.
    for view in &mut dataset.train {
        view.mask.as_mut().unwrap().kind = MaskKind::Used;
    }
    assert_eq!(surroundings(&dataset, None, true).source, SphereSource::Cameras);
}

/// The sphere before a backdrop with these radiances along a direction; parts of the ball have its
/// colours.
fn before_backdrop(radiance: impl Fn(DVec3) -> f64) -> Surroundings {
    let mut dataset = photographed(&cameras(24));
    for view in &mut dataset.train {
        let (camera, empty) = (view.camera, view.image.at(0, 0));
        for (i, pixel) in view.image.pixels.iter_mut().enumerate().filter(|p| *p.1 == empty) {
            let place = [i as u32 % camera.width, i as u32 / camera.width].map(f64::from);
            *pixel = [radiance(camera.direction(DVec2::from(place) + 0.5)) as f32; 3];
        }
    }
    surroundings(&dataset, None, false)
}

#[test]
fn outlines_before_smooth_backdrops_give_the_sphere() {
    for slope in [0.0, 0.1, 0.2, 0.4] {
        let found = before_backdrop(|direction| 0.6 + slope * direction.z);
        assert_eq!(found.source, SphereSource::Outlines, "{slope}");
        assert!(holds_the_ball(&found.sphere), "{slope}: {:?}", found.sphere);
    }
}

#[test]
fn outlines_before_a_backdrop_with_a_pattern_are_no_evidence() {
    let found = before_backdrop(|direction| 0.6 + 0.2 * (40.0 * direction.z).sin());
    let off = (found.sphere.center - ball().center).length();
    assert!(off + ball().radius < found.sphere.radius, "{:?}", found.sphere);
    assert_eq!(found.source, SphereSource::Cameras);
}

/// `count` points spread evenly over a sphere, as a textured object gives them.
fn points_on(sphere: Sphere<f64>, count: usize) -> Vec<DVec3> {
    let place = |i: usize| {
        let (z, turn) = (1.0 - 2.0 * (i as f64 + 0.5) / count as f64, 2.4 * i as f64);
        let ring = (1.0 - z * z).sqrt();
        sphere.center + sphere.radius * DVec3::new(ring * turn.cos(), ring * turn.sin(), z)
    };
    (0..count).map(place).collect()
}

/// Photographs that tell nothing about the sphere.
fn in_clutter() -> Dataset {
    let mut dataset = painted(|_, _, _| {});
    for (number, view) in dataset.train.iter_mut().enumerate() {
        for (i, p) in view.image.pixels.iter_mut().enumerate() {
            *p = [7, 11, 5].map(|n| ((i * 37 + number * 17) % n) as f32 / n as f32);
        }
    }
    dataset
}

#[test]
fn points_on_an_object_beside_the_aimed_point_move_and_enlarge_the_sphere() {
    let mut dataset = in_clutter();
    let without = surroundings(&dataset, None, false).sphere;
    let beside = Sphere { center: ball().center + DVec3::X * 0.6, radius: 0.6 };
    dataset.points = points_on(beside, 400);
    let found = surroundings(&dataset, None, false);
    let reach = |sphere: &Sphere<f64>| sphere.radius - sphere.center.distance(beside.center);
    assert!(reach(&without) < beside.radius, "{without:?}");
    assert_eq!(found.source, SphereSource::Points);
    assert!(reach(&found.sphere) > beside.radius, "{:?}", found.sphere);
    // Points of a room do not: as many lie on its walls.
    dataset.points.extend(points_on(without.scaled(4.0), 400));
    let found = surroundings(&dataset, None, false);
    assert_eq!(found.source, SphereSource::Points);
    assert_relative_eq!(found.sphere.center, without.center, epsilon = 1e-9);
    assert!(found.sphere.radius <= without.radius, "{:?}", found.sphere);
}

#[test]
fn points_that_masks_show_come_before_masks_and_those_of_the_room_do_not_count() {
    let mut dataset = in_clutter();
    let clean = photographed(&cameras(12));
    let empty = clean.train[0].image.at(0, 0);
    for (view, clean) in dataset.train.iter_mut().zip(&clean.train) {
        let shown = clean.image.pixels.iter().map(|p| f32::from(u8::from(*p != empty)));
        view.mask = Some(Mask { kind: MaskKind::Object, values: shown.collect() });
    }
    dataset.points = points_on(ball(), 200);
    dataset.points.extend(points_on(ball().scaled(4.0), 2000));
    let found = surroundings(&dataset, None, true);
    assert_eq!(found.source, SphereSource::Points);
    assert!(holds_the_ball(&found.sphere), "{:?}", found.sphere);
    // Two masks without most of the ball break the hull, and not the points.
    for view in dataset.train.iter_mut().take(2) {
        let most = 3 * view.image.pixels.len() / 4;
        view.mask.as_mut().unwrap().values[..most].fill(0.0);
    }
    let found = surroundings(&dataset, None, true);
    assert!(holds_the_ball(&found.sphere), "{:?}", found.sphere);
    dataset.points.clear();
    let found = surroundings(&dataset, None, true);
    assert_eq!(found.source, SphereSource::Masks);
    assert!(!holds_the_ball(&found.sphere), "{:?}", found.sphere);
}

/// A number in [0, 1) for a place, without a pattern.
fn hash(x: u64) -> f64 {
    let mixed = (x + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1u64 << 53) as f64
}

/// The ball in front of a backdrop in film coordinates: stripes on a gradient.
fn backdrop(i: usize) -> f64 {
    let (x, y) = (i % 48, i / 48);
    0.15 + 0.01 * y as f64 + 0.4 * hash((x / 3 + 100 * (y / 9)) as u64)
}

/// The photographs of 24 cameras in front of the radiance of `shown`, which gets the number of the
/// view, the number of the pixel and the direction of its ray.
fn in_front_of(shown: impl Fn(usize, usize, DVec3) -> [f64; 3]) -> Dataset {
    let mut dataset = photographed(&cameras(24));
    for (number, view) in dataset.train.iter_mut().enumerate() {
        let (camera, empty) = (view.camera, view.image.at(0, 0));
        for (i, pixel) in view.image.pixels.iter_mut().enumerate().filter(|p| *p.1 == empty) {
            let place = [i as u32 % camera.width, i as u32 / camera.width].map(f64::from);
            let direction = camera.direction(DVec2::from(place) + 0.5);
            *pixel = shown(number, i, direction).map(|v| v as f32);
        }
    }
    dataset
}

/// Colours of a radiance.
fn tinted(radiance: f64) -> [f64; 3] {
    [radiance, 0.8 * radiance + 0.05, 0.4]
}

#[test]
fn a_backdrop_that_stands_still_in_the_image_is_found() {
    let clean = in_front_of(|_, i, _| tinted(backdrop(i)));
    // Noise, other exposures, and three of 21 views with another backdrop.
    let harmed = in_front_of(|number, i, _| {
        let gain = 0.9 + 0.2 * hash(7000 + number as u64);
        let noise = 0.01 * (hash((i + 5000 * number) as u64) - 0.5);
        let i = if number % 7 == 3 { i + 13 } else { i };
        tinted(backdrop(i)).map(|v| gain * (v + noise))
    });
    for dataset in [clean, harmed] {
        let found = surroundings(&dataset, None, false);
        assert!(found.is_still() && !found.is_uniform(), "{:?}", found.still);
        assert!(found.still.share > 0.9, "{:?}", found.still);
        assert_eq!(found.source, SphereSource::Outlines);
        assert!(holds_the_ball(&found.sphere), "{:?}", found.sphere);
        let report = inspect(&dataset, &found.sphere, &found.background, "").to_string();
        assert!(report.contains("\nbackdrop     stands still"), "{report}");
        assert!(report.contains("--background picture"), "{report}");
    }
}

#[test]
fn other_backdrops_do_not_stand_still() {
    let share = |dataset: &Dataset| {
        let found = surroundings(dataset, None, false);
        let report = inspect(dataset, &found.sphere, &found.background, "").to_string();
        assert!(!report.contains("backdrop"), "{report}");
        found.still.share
    };
    let uniform = in_front_of(|_, _, _| [0.5; 3]);
    let of_view = in_front_of(|number, i, _| tinted(backdrop(i + 13 * number)));
    let panorama = in_front_of(|_, _, d| tinted(0.4 + 0.2 * (9.0 * d.x).sin() * (8.0 * d.y).cos()));
    let sky = in_front_of(|_, _, d| tinted(if d.z > 0.0 { 0.9 } else { 0.2 }));
    let shares = [uniform, of_view, panorama, sky].map(|dataset| share(&dataset));
    assert!(shares.iter().all(|share| *share < 0.5), "{shares:?}");
    // Frames of a video from one side: the room stands nearly still.
    let mut near = in_front_of(|_, i, _| tinted(backdrop(i)));
    let camera = near.train[0].camera;
    near.train.iter_mut().for_each(|view| view.camera = camera);
    assert_eq!(share(&near), 0.0);
}
