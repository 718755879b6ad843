//! Recognition of the format, the bounding sphere, the background, and the check of the cameras.

use super::*;

#[test]
fn folders_without_cameras_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["no camera file", "transforms.json", "COLMAP"]);
    refused(&folder.path().join("nowhere"), &["nowhere"]);
}

#[test]
fn cameras_inside_the_sphere_or_looking_away_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(9));
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(12));
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
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
fn cameras_at_one_place_and_lenses_of_no_camera_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let json = write_nerf(folder.path(), "transforms.json", &cameras(9));
    let mut dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(check_places(&dataset).is_ok());
    let eye = dataset.train[0].camera.eye;
    dataset.train.iter_mut().chain(&mut dataset.test).for_each(|view| view.camera.eye = eye);
    let error = check_places(&dataset).unwrap_err().to_string();
    assert!(error.contains("9 cameras at one place"), "{error}");
    for (key, number, words) in [
        ("fl_x", 1e300, ["focal length", "1e300"]),
        ("fl_x", 1e-9, ["focal length", "1e-9"]),
        ("cx", 1e30, ["principal point", "1e30"]),
    ] {
        let mut json = json.clone();
        json[key] = number.into();
        write_json(&folder.path().join("transforms.json"), &json);
        refused(folder.path(), &[&words[..], &["pixels"]].concat());
    }
}

/// The data set of [`write_nerf`] with the photographs changed by `paint`, which gets the view's
/// number and whether the pixel shows the ball.
fn painted(paint: impl Fn(usize, bool, &mut [f32; 3])) -> Dataset {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(12));
    let mut dataset = load(folder.path(), &LoadOptions::default()).unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(24));
    let mut dataset = load(folder.path(), &LoadOptions::default()).unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(12));
    let clean = load(folder.path(), &LoadOptions::default()).unwrap();
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
