//! One rendered scene in the forms of many programs: each has the cameras of the NeRF form.
//! `fixtures/forms/make.py` writes the camera files, without code of dsdf.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::{Dataset, LoadOptions, View, load};
use tests::root;

/// The largest difference of a camera's numbers from those of the NeRF form, in pixels for the
/// focal length and the principal point, and in world units.
const SAME: f64 = 1e-4;

fn fixtures() -> PathBuf {
    root().join("tests/fixtures/forms")
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copy_folder(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

/// All views by the number in the name of their image.
fn by_number(dataset: &Dataset) -> BTreeMap<usize, &View> {
    let number = |view: &View| {
        let name = Path::new(&view.name).file_stem().unwrap().to_string_lossy().into_owned();
        name.parse::<usize>().unwrap()
    };
    dataset.train.iter().chain(&dataset.test).map(|view| (number(view), view)).collect()
}

#[test]
fn every_form_has_the_cameras_and_photographs_of_the_nerf_form() {
    let nerf = load(&fixtures().join("nerf"), &LoadOptions::default()).unwrap();
    let expected = by_number(&nerf);
    assert_eq!(expected.len(), 9);
    // The form, the folder of its images, and the digits of their names.
    let cases = [
        ("nerfstudio", "images", 3),
        ("named", "images", 3),
        ("colmap_text", "images", 3),
        ("colmap_binary", "input", 3),
        ("reduced", "images_2", 3),
        ("neus", "image", 3),
        ("idr", "image", 3),
        ("blended_mvs", "blended_images", 8),
        ("llff", "images", 3),
        ("middlebury", "", 3),
        ("metashape", "images", 3),
    ];
    for (form, images, digits) in cases {
        let folder = tempfile::tempdir().unwrap();
        copy_folder(&fixtures().join(form), folder.path());
        fs::create_dir_all(folder.path().join(images)).unwrap();
        for i in 0..9 {
            let from = fixtures().join(format!("nerf/images/{i:03}.png"));
            let name = format!("{i:0digits$}.png");
            fs::copy(from, folder.path().join(images).join(name)).unwrap();
        }
        let file = folder.path().join("transforms_exact.json");
        let path = if form == "named" { file.as_path() } else { folder.path() };
        let found = load(path, &LoadOptions::default()).unwrap();
        let notes = usize::from(["colmap_text", "reduced"].contains(&form));
        assert_eq!(found.notes.len(), notes, "{form}: {:?}", found.notes);
        let views = by_number(&found);
        assert_eq!(views.len(), 9, "{form}");
        for (view, of_nerf) in views.values().zip(expected.values()) {
            let (a, b) = (&view.camera, &of_nerf.camera);
            assert_eq!((a.width, a.height), (b.width, b.height), "{form}");
            let films = [(a.focal, b.focal), (a.principal, b.principal)];
            let film = films.map(|(p, q)| (p - q).abs().max_element());
            let axes = [(a.eye, b.eye), (a.right, b.right), (a.up, b.up), (a.forward, b.forward)];
            let axes = axes.map(|(p, q)| (p - q).abs().max_element());
            let most = film.into_iter().chain(axes).fold(0.0, f64::max);
            assert!(most <= SAME, "{form}, {}: {most}", view.name);
            assert_eq!(view.image, of_nerf.image, "{form}, {}", view.name);
        }
    }
}
