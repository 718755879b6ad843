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
    let (bounds, background) = surroundings(&dataset, None);
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
    assert_eq!(surroundings(&dataset, Some(ball())).0, ball());
}
