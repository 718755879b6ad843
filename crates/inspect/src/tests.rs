//! The report on views with known figures, and the drawn outline against rays that meet the sphere.

use crate::BackgroundEstimate;
use dataset::{Dataset, Distortion, Mask, MaskKind, View};
use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;

use super::*;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::new(1.0, 2.0, 3.0), radius: 0.5 };

/// Cameras at a distance of 4 along the six directions of the axes, 60 × 50 pixels.
fn dataset() -> Dataset {
    let view = |i: usize, axis: DVec3| {
        let up = if axis.z == 0.0 { DVec3::Z } else { DVec3::X };
        let (focal, principal) = (DVec2::splat(120.0), DVec2::new(30.0, 25.0));
        let eye = BOUNDS.center + 4.0 * axis;
        let camera = Camera::look_at(60, 50, focal, principal, eye, BOUNDS.center, up).unwrap();
        View {
            name: format!("{i}"),
            path: Default::default(),
            camera,
            image: Film::new(60, 50),
            mask: None,
        }
    };
    let axes = DVec3::AXES.into_iter().flat_map(|a| [a, -a]).enumerate();
    let mut train: Vec<View> = axes.map(|(i, axis)| view(i, axis)).collect();
    let test = train.split_off(5);
    Dataset {
        path: "set".into(),
        format: "test".to_owned(),
        train,
        test,
        bounds: None,
        points: Vec::new(),
        is_sure: Vec::new(),
        notes: Vec::new(),
    }
}

fn report(dataset: &Dataset) -> Report {
    let background = BackgroundEstimate { color: [0.1, 0.2, 0.3], spread: 0.01, confidence: 0.7 };
    inspect(dataset, &BOUNDS, &background, "as asked")
}

#[test]
fn views_of_one_pose_and_distant_principal_points_are_named() {
    assert!(report(&dataset()).warnings.is_empty());
    let mut doubled = dataset();
    doubled.test[0].camera = doubled.train[3].camera;
    let warnings = report(&doubled).warnings;
    assert!(warnings[0].starts_with("2 of 6 views have the pose of another view, 3 and 5"));
    let mut cropped = dataset();
    cropped.train[2].camera.principal = DVec2::new(60.0, 25.0);
    let warnings = report(&cropped).warnings;
    assert!(warnings[0].contains("that of 2 at 60, 25 of 60 x 50 pixels"), "{warnings:?}");
}

#[test]
fn a_tiny_scene_has_its_digits() {
    let mut tiny = dataset();
    for view in tiny.train.iter_mut().chain(&mut tiny.test) {
        view.camera.eye *= 1e-5;
    }
    let bounds = Sphere { center: BOUNDS.center * 1e-5, radius: BOUNDS.radius * 1e-5 };
    let text = inspect(&tiny, &bounds, &BackgroundEstimate::NOTHING, "as asked").to_string();
    assert!(text.contains("radius 5.000e-6"), "{text}");
    assert!(text.contains("cameras      4.000e-5 to 4.000e-5"), "{text}");
}

#[test]
fn the_report_has_the_known_figures() {
    let report = report(&dataset());
    assert_eq!(
        (report.train_views, report.test_views, report.masks, report.axes_through),
        (5, 1, 0, 6)
    );
    assert!(report.distance.iter().all(|d| (d - 4.0).abs() < 1e-12));
    assert!((report.spread - 180.0).abs() < 1e-9 && report.off_axis < 1e-5, "{report:?}");
    assert!(report.elevation.iter().zip([-90.0, 90.0]).all(|(a, b)| (a - b).abs() < 1e-9));
    assert!((report.field_of_view - 2.0 * 0.25f64.atan().to_degrees()).abs() < 1e-12);
    // Six caps of 30 degrees that do not overlap: 6 (1 - cos 30°) / 2.
    assert!((report.surrounded - 0.4019).abs() < 0.01, "{}", report.surrounded);
    // The disc of the tangent 0.5 / √(4² − 0.5²), times the focal length, in pixels.
    let disc = std::f64::consts::PI * (120.0 * 0.5 / 15.75f64.sqrt()).powi(2) / 3000.0;
    assert!(
        report.coverage.iter().all(|c| (c - disc).abs() < 0.01),
        "{:?} and {disc}",
        report.coverage
    );
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let text = report.to_string();
    for words in [
        "60 x 50",
        "5 to fit, 1 held out",
        "6 of 6 axes",
        "radius 0.5000, as asked",
        "confidence 0.70",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["image_size"], serde_json::json!([60, 50]));
}

#[test]
fn sizes_and_lenses_have_rows() {
    let mut dataset = dataset();
    dataset.train[1].camera = dataset.train[1].camera.resized(50, 60);
    dataset.test[0].camera = dataset.test[0].camera.resized(50, 60);
    let mut report = report(&dataset);
    let row = |report: &Report, label: &str| {
        let text = report.to_string();
        text.lines().find(|line| line.starts_with(label)).map(|line| line[13..].to_owned())
    };
    assert!(row(&report, "images").unwrap().starts_with("4 of 60 x 50, 2 of 50 x 60 pixels, "));
    assert_eq!(row(&report, "lens"), None, "an unknown lens has no row");
    let mut lens = |views, fisheye, pixels| {
        report.distortion = Some(Distortion { views, fisheye, pixels });
        row(&report, "lens").unwrap()
    };
    assert_eq!(lens(0, 0, 0.0), "no distortion");
    assert_eq!(lens(6, 0, 4.256), "distortion of up to 4.26 pixels, removed in 6 views");
    let both =
        "fisheye, undistorted in 4 views; distortion of up to 1.00 pixels, removed in 2 views";
    assert_eq!(lens(6, 4, 1.0), both);
}

#[test]
fn suspicious_views_give_warnings() {
    let mut turned = dataset();
    for view in &mut turned.train {
        view.camera.forward = -view.camera.forward;
        view.camera.up = -view.camera.up;
    }
    let found = report(&turned);
    assert!(
        found.warnings.iter().any(|w| w.contains("5 of 6") && w.contains("OpenCV")),
        "{:?}",
        found.warnings
    );
    assert!(found.warning_rows().starts_with("\nWARNING      "));
    assert_eq!(found.axes_through, 1);

    let mut near = dataset();
    near.train[1].camera.eye = BOUNDS.center + DVec3::X * 0.4;
    near.train[2].camera = near.train[2].camera.resized(30, 25);
    near.train.truncate(3);
    let warnings = report(&near).warnings.join("; ");
    for words in ["inside the bounding sphere", "1 images are of another size"] {
        assert!(warnings.contains(words), "no {words:?} in {warnings}");
    }
    near.train[0].mask = Some(Mask { kind: MaskKind::Object, values: vec![1.0; 3000] });
    let warnings = report(&near).warnings.join("; ");
    assert!(warnings.contains("only 1 of 3 views to fit have a mask"), "{warnings}");
    near.train.truncate(2);
    assert!(report(&near).warnings.iter().any(|w| w.contains("fewer than three")));
}

#[test]
fn masks_without_an_object_give_a_warning_with_a_name() {
    let warned = |kind, even: usize| {
        let mut dataset = dataset();
        for (i, view) in dataset.train.iter_mut().enumerate() {
            let mut values = vec![1.0; view.image.pixels.len()];
            if i >= even {
                values[7] = 0.0;
            }
            view.mask = Some(Mask { kind, values });
        }
        let warnings = report(&dataset).warnings;
        warnings.into_iter().find(|text| text.contains("everywhere"))
    };
    let text = warned(MaskKind::Object, 2).unwrap();
    assert!(
        text.starts_with("2 of 5 masks") && text.contains("that of 0. White is the object"),
        "{text}"
    );
    assert!(warned(MaskKind::Object, 5).is_some() && warned(MaskKind::Alpha, 1).is_some());
    // An alpha channel that is opaque everywhere is common.
    assert!(warned(MaskKind::Alpha, 5).is_none() && warned(MaskKind::Object, 0).is_none());
}

#[test]
fn the_outline_separates_rays_that_meet_the_sphere_from_others() {
    let mut dataset = dataset();
    // Aimed beside the sphere's centre, so that the outline is an ellipse.
    let camera = &mut dataset.train[0].camera;
    let target = BOUNDS.center + DVec3::new(0.0, 0.45, 0.2);
    *camera = Camera::look_at(60, 50, camera.focal, camera.principal, camera.eye, target, DVec3::Z)
        .unwrap();
    let camera = dataset.train[0].camera;
    let sheet = below_label(&overlay(&dataset, &BOUNDS, &[]));
    let hit = |u: DVec2| BOUNDS.clip(camera.eye, camera.direction(u)).is_some();
    let (mut marked, mut boundary) = (0, 0);
    for y in 0..50 {
        for x in 0..60 {
            let u = DVec2::new(f64::from(x), f64::from(y));
            let around: Vec<bool> = (0..9)
                .map(|i| hit(u + DVec2::new(f64::from(i % 3), f64::from(i / 3)) * 0.5))
                .collect();
            let crossed = around.iter().any(|h| *h != around[0]);
            let [r, g, b] = sheet.at(x, y);
            let orange = r == 1.0 && g == 0.6 && b == 0.0;
            marked += u32::from(orange);
            boundary += u32::from(crossed);
            // The outline may cut a corner of the pixel between its nine rays.
            let near = (0..25).any(|i| {
                hit(u + DVec2::new(f64::from(i % 5), f64::from(i / 5)) * 0.5 - 0.5) != around[4]
            });
            assert!(!orange || near, "pixel {x}, {y}");
            assert!(
                orange || !crossed || is_axis([r, g, b]) || cuts_corner(&around),
                "pixel {x}, {y}"
            );
        }
    }
    assert!(marked > 60 && boundary > 60, "{marked} of {boundary}");
}

/// The picture without the label of its first row: twelve rows of pixels.
fn below_label(sheet: &Film) -> Film {
    let label = (12 * sheet.width) as usize;
    Film { height: sheet.height - 12, pixels: sheet.pixels[label..].to_vec(), ..*sheet }
}

/// True for the colours of the three axes.
fn is_axis([r, g, b]: [f32; 3]) -> bool {
    r > 0.9 && g < 0.1 || g > 0.7 && r < 0.1 || b > 0.9 && r < 0.2
}

/// True if all but one or two of the nine rays agree: the outline cuts at most a corner.
fn cuts_corner(around: &[bool]) -> bool {
    let hits = around.iter().filter(|h| **h).count();
    hits <= 2 || hits >= 7
}

#[test]
fn the_axes_are_drawn_along_world_x_y_and_z() {
    // From +x, with z up: y to the right, z up, x towards the eye.
    let sheet = below_label(&overlay(&dataset(), &BOUNDS, &[]));
    assert_eq!(sheet.at(36, 25), [0.05, 0.8, 0.05]);
    assert_eq!(sheet.at(30, 18), [0.1, 0.2, 1.0]);
    assert_eq!(sheet.at(22, 25), [0.0; 3]);
}
