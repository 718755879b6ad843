//! Sphere and background of data sets outside the repository. A test is skipped if its data set is
//! missing.

use std::io::Write;
use std::path::{Path, PathBuf};

use dataset::{Dataset, LoadOptions, View, load};
use field::Sphere;
use glam::DVec3;

use crate::{BackgroundEstimate, Surroundings, check_cameras, surroundings};

/// The path of a data set beside the workspace. If it is missing, prints a line and returns `None`.
fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    if path.is_dir() {
        return Some(path);
    }
    // Not `eprintln!`, whose output the test harness captures.
    let _ = writeln!(std::io::stderr(), "SKIPPED: no data set {}", path.display());
    None
}

/// A data set with its estimated sphere and background; its cameras are checked.
fn estimated(name: &str) -> Option<(Dataset, Sphere<f64>, BackgroundEstimate)> {
    let dataset = load(&shared(name)?, &LoadOptions::default()).unwrap();
    let Surroundings { sphere: bounds, background, .. } = surroundings(&dataset, None, false);
    eprintln!("{name}: {bounds:?} {background:?}");
    check_cameras(&dataset, &bounds).unwrap();
    Some((dataset, bounds, background))
}

/// True if a sphere contains `object` and its radius is at most `most` times as large.
fn encloses(found: &Sphere<f64>, object: &Sphere<f64>, most: f64) -> bool {
    let off = (found.center - object.center).length();
    off + object.radius <= found.radius && found.radius <= most * object.radius
}

#[test]
fn renders_of_a_cow_and_a_duck_give_a_tight_sphere() {
    // The smallest spheres around the vertices of the true meshes.
    let cow = Sphere { center: DVec3::new(0.0, -0.0808, 0.0033), radius: 0.9031 };
    let duck = Sphere { center: DVec3::new(-0.0016, 0.0, -0.0253), radius: 0.9447 };
    for (name, object, color) in [("spot", cow, [0.0; 3]), ("bob", duck, [0.3, 0.35, 0.4])] {
        let Some((dataset, bounds, background)) = estimated(name) else { continue };
        assert_eq!((dataset.train.len(), dataset.test.len()), (32, 8));
        assert!(dataset.train.iter().chain(&dataset.test).all(|v| v.mask.is_some()));
        assert!(encloses(&bounds, &object, 1.2), "{name}: {bounds:?}");
        assert!(background.confidence > 0.95, "{name}: {background:?}");
        assert!(
            background.color.iter().zip(color).all(|(a, b)| (a - b).abs() < 0.005),
            "{name}: {background:?}"
        );
    }
}

#[test]
fn photographs_of_a_dinosaur_give_a_sphere_around_its_box() {
    let Some((dataset, bounds, background)) = estimated("dinoSparseRing") else { return };
    // Fewer than 20 photographs without a split of their own: none is held out.
    assert_eq!((dataset.train.len(), dataset.test.len()), (16, 0));
    // The object's tight box, from the benchmark's page.
    let (low, high) =
        (DVec3::new(-0.061897, -0.018874, -0.057845), DVec3::new(0.010897, 0.068227, 0.015495));
    for axis in 0..3 {
        assert!(
            bounds.center[axis] - bounds.radius < low[axis]
                && high[axis] < bounds.center[axis] + bounds.radius
        );
    }
    assert!((bounds.center - (low + high) / 2.0).length() < 0.02, "{bounds:?}");
    assert!((0.05..0.085).contains(&bounds.radius), "{bounds:?}");
    assert!(
        background.confidence > 0.9 && background.color.iter().all(|c| *c < 0.01),
        "{background:?}"
    );
}

#[test]
fn a_cluttered_room_has_no_background_confidence() {
    let Some((dataset, bounds, background)) = estimated("dtu_scan65_400x300") else { return };
    assert_eq!((dataset.train.len(), dataset.test.len()), (42, 7));
    assert_eq!(Some(bounds), dataset.bounds);
    assert!(background.confidence < 0.1, "{background:?}");
    // Every optical axis passes through the data set's own sphere.
    let through = |v: &View| bounds.clip(v.camera.eye, v.camera.forward).is_some();
    assert!(dataset.train.iter().chain(&dataset.test).all(through));
}

#[test]
fn photographs_of_a_room_without_points_give_a_sphere_around_the_object() {
    // The smallest spheres around the vertices of the true meshes.
    for (name, center, radius) in [
        ("bob_room", DVec3::new(1.2978, -0.6967, 0.8546), 0.1492),
        ("spot_room", DVec3::new(1.3064, -0.711, 0.8574), 0.1426),
    ] {
        let Some(path) = shared(name) else { continue };
        let dataset = load(&path, &LoadOptions { downscale: 2 }).unwrap();
        let found = surroundings(&dataset, None, false).with_matches(&dataset);
        let object = Sphere { center, radius };
        assert!(encloses(&found.sphere, &object, 1.5), "{name}: {:?}", found.sphere);
        assert!(found.points.len() > 3000);
    }
}
