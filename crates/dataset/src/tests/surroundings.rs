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

/// A backdrop that is lit from above: it seems uniform, and parts of the ball have its colours.
#[test]
fn outlines_before_a_backdrop_that_is_not_uniform_are_no_evidence() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(24));
    let with_slope = |slope: f64| {
        let mut dataset = load(folder.path(), &LoadOptions::default()).unwrap();
        for view in &mut dataset.train {
            let (camera, empty) = (view.camera, view.image.at(0, 0));
            for (i, pixel) in view.image.pixels.iter_mut().enumerate().filter(|p| *p.1 == empty) {
                let place = [i as u32 % camera.width, i as u32 / camera.width].map(f64::from);
                let direction = camera.direction(DVec2::from(place) + 0.5);
                *pixel = [(0.6 + slope * direction.z) as f32; 3];
            }
        }
        surroundings(&dataset, None, false)
    };
    let even = with_slope(0.0);
    assert!(even.source == SphereSource::Outlines && holds_the_ball(&even.sphere), "{even:?}");
    let uneven = with_slope(0.4);
    let off = (uneven.sphere.center - ball().center).length();
    assert!(off + ball().radius < uneven.sphere.radius, "{:?}", uneven.sphere);
    assert_eq!(uneven.source, SphereSource::Cameras);
}
