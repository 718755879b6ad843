//! Variants of a data set of renders: the pixels against values by hand, the backgrounds between
//! views, and data sets that load.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::{Path, PathBuf};

use dataset::{Dataset, LoadOptions, View, load};
use film::{srgb_decode, srgb_encode};
use serde_json::{Value, json};
use tests::compose::{Kind, compose};

const SIZE: usize = 24;

/// The background of the renders, as display values of 8 bits.
const OWN: [u8; 3] = [64, 128, 192];

/// A ball before [`OWN`] in four views and a held-out one. The last training view has the image of
/// the first one, and a camera elsewhere that is rolled by 90 degrees.
struct Renders {
    folder: tempfile::TempDir,
}

impl Renders {
    fn new() -> Self {
        let background = OWN.map(|byte| srgb_decode(f32::from(byte) / 255.0));
        let file = json!({
            "camera": {"width": 8, "height": 8, "focal": 8, "principal": [4, 4],
                       "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
            "sdf": {"type": "sphere", "center": [0.2, 0, 0], "radius": 0.5},
            "appearance": {"type": "normal"},
            "background": background
        });
        let folder = tempfile::tempdir().unwrap();
        let scene = scene::SceneFile::from_value("ball.json".as_ref(), &file).unwrap();
        let options = scene::synth::Options { views: 3, size: [SIZE as u32; 2], spp: 16, seed: 0 };
        let data = folder.path().join("data");
        scene::synth::synthesise(&scene, "ball.json".as_ref(), &data, &options, &|_| {}).unwrap();
        add_rolled_view(&data.join("transforms_train.json"));
        Renders { folder }
    }

    fn source(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// Writes a variant into a new folder.
    fn compose(&self, kind: Kind, seed: u64, name: &str) -> Variant {
        let folder = self.folder.path().join(name);
        let mut fractions = Vec::new();
        compose(kind, &self.source(), &folder, seed, &mut |p| fractions.push(p)).unwrap();
        assert_eq!(fractions, [0.2, 0.4, 0.6, 0.8, 1.0]);
        let dataset = loaded(&folder);
        Variant { folder, dataset }
    }
}

/// Adds a frame with the image of the first one. The camera is rolled by 90 degrees about its axis,
/// which the image is not: only its background can tell.
fn add_rolled_view(file: &Path) {
    let mut transforms: Value = files::json::read(file).unwrap();
    let mut frame = transforms["frames"][0].clone();
    for row in frame["transform_matrix"].as_array_mut().unwrap().iter_mut().take(3) {
        let old = row.clone();
        row[0] = old[1].clone();
        row[1] = (-old[0].as_f64().unwrap()).into();
        row[3] = (old[3].as_f64().unwrap() + 0.3).into();
    }
    transforms["frames"].as_array_mut().unwrap().push(frame);
    std::fs::write(file, transforms.to_string()).unwrap();
}

struct Variant {
    folder: PathBuf,
    dataset: Dataset,
}

impl Variant {
    /// The entry of each training view in `compose.json`.
    fn record(&self) -> Vec<Value> {
        let record = files::json::read(&self.folder.join("compose.json")).unwrap();
        record["views"].as_array().unwrap()[..self.dataset.train.len()].to_vec()
    }
}

fn loaded(folder: &Path) -> Dataset {
    load(folder, &LoadOptions::default()).unwrap()
}

/// The display values of a pixel, 0 to 255.
fn bytes(view: &View, i: usize) -> [f32; 3] {
    view.image.pixels[i].map(|v| 255.0 * srgb_encode(v))
}

fn mask(view: &View) -> &[f32] {
    view.coverage().unwrap()
}

/// Checks that the coverage is that of the source, up to the rounding of its display values.
fn check_mask(made: &View, source: &View) {
    for (i, (a, b)) in mask(made).iter().zip(mask(source)).enumerate() {
        assert!((a - b).abs() < 1e-6, "{}, pixel {i}: {a}, not {b}", made.name);
    }
}

/// Checks each pixel of the training views of a variant against `expected`, a function of the
/// view's number, the light of the object (linear RGB) and the coverage, within 0.51 steps of
/// 8 bits: the rounding of the file.
fn check_pixels(
    variant: &Variant,
    source: &Dataset,
    expected: impl Fn(usize, [f32; 3], f32) -> [f32; 3],
) {
    let own = OWN.map(|byte| srgb_decode(f32::from(byte) / 255.0));
    let mut partial = 0;
    for (n, (made, source)) in variant.dataset.train.iter().zip(&source.train).enumerate() {
        check_mask(made, source);
        for (i, a) in mask(source).iter().enumerate() {
            partial += usize::from(*a > 0.2 && *a < 0.8);
            let pixel = source.image.pixels[i];
            let object = [0, 1, 2].map(|c| (pixel[c] - (1.0 - a) * own[c]).max(0.0));
            let expected = expected(n, object, *a).map(|v| 255.0 * srgb_encode(v.clamp(0.0, 1.0)));
            let found = bytes(made, i);
            let off = [0, 1, 2].map(|c| (found[c] - expected[c]).abs());
            assert!(off.iter().all(|o| *o < 0.51), "view {n}, {i}: {found:?}, not {expected:?}");
        }
    }
    assert!(partial > 20, "{partial} pixels with the ball's outline");
}

#[test]
fn every_kind_is_a_data_set_with_the_poses_and_the_mesh_of_its_source() {
    let renders = Renders::new();
    let source = loaded(&renders.source());
    let mesh = std::fs::read(renders.source().join("truth.ply")).unwrap();
    let kinds = [
        Kind::Panorama,
        Kind::Noise,
        Kind::GreyExposure,
        Kind::PerView,
        Kind::Turntable,
        Kind::TurntableNoise,
        Kind::Black,
    ];
    for kind in [&kinds[..], &[Kind::Alpha]].concat() {
        let Variant { folder, dataset } = renders.compose(kind, 7, &format!("{kind:?}"));
        assert_eq!((dataset.train.len(), dataset.test.len()), (4, 1));
        let views = |d: &Dataset| [&d.train[..], &d.test[..]].concat();
        for (made, source) in views(&dataset).iter().zip(&views(&source)) {
            let (made_pose, pose) = (made.camera.pose(), source.camera.pose());
            assert!(made_pose.abs_diff_eq(pose, 1e-12), "{kind:?}: {made_pose} and {pose}");
            assert!((made.camera.focal - source.camera.focal).length() < 1e-9);
            check_mask(made, source);
        }
        assert_eq!(folder.join("masks").exists(), kind != Kind::Alpha);
        assert!(std::fs::read(folder.join("truth.ply")).unwrap() == mesh);
    }
}

#[test]
fn colours_and_exposures_are_composited_in_linear_light() {
    let renders = Renders::new();
    let source = loaded(&renders.source());
    check_pixels(&renders.compose(Kind::Black, 0, "black"), &source, |_, object, _| object);

    let colors = renders.compose(Kind::PerView, 3, "colours");
    let record = colors.record();
    let color = |n: usize, c: usize| record[n]["background"][c].as_f64().unwrap() as f32;
    check_pixels(&colors, &source, |n, object, a| {
        [0, 1, 2].map(|c| object[c] + (1.0 - a) * color(n, c))
    });
    assert!((0..3).any(|c| (color(0, c) - color(1, c)).abs() > 0.1), "{record:?}");

    let grey = renders.compose(Kind::GreyExposure, 3, "grey");
    let record = grey.record();
    let stops: Vec<f64> = (0..4).map(|n| record[n]["stops"].as_f64().unwrap()).collect();
    check_pixels(&grey, &source, |n, object, a| {
        object.map(|o| 2f32.powf(stops[n] as f32) * (o + (1.0 - a) * 0.18))
    });
    assert!(stops.iter().all(|e| e.abs() < 0.7), "{stops:?}");
    assert!((stops[0] - stops[1]).abs() > 0.05, "{stops:?}");
}

#[test]
fn alpha_is_straight_and_black_where_nothing_is_covered() {
    let renders = Renders::new();
    let (alpha, black) =
        (renders.compose(Kind::Alpha, 0, "alpha"), renders.compose(Kind::Black, 0, "black"));
    for (view, black) in alpha.dataset.train.iter().zip(&black.dataset.train) {
        let file = image::open(&view.path).unwrap();
        assert_eq!(file.color(), image::ColorType::Rgba8);
        let file = file.into_rgba8();
        assert!(file.pixels().any(|p| p.0[3] == 0) && file.pixels().any(|p| p.0[3] == 255));
        assert!(file.pixels().all(|p| p.0[3] > 0 || p.0 == [0; 4]));
        // Straight: a pixel on the outline is as bright as those inside, by hand l / a.
        for (i, (p, a)) in file.pixels().zip(mask(view)).enumerate().filter(|(_, (_, a))| **a > 0.0)
        {
            let light = black.image.pixels[i];
            for (c, light) in light.into_iter().enumerate() {
                // Half a step of 8 bits in the light of `black`, which the division enlarges, and
                // half a step of this file.
                let (low, high) = ((light - 0.006) / a - 0.006, (light + 0.006) / a + 0.006);
                let found = srgb_decode(f32::from(p.0[c]) / 255.0);
                assert!((low..=high).contains(&found) || found == 1.0, "{p:?}, {light}");
            }
        }
        for (i, light) in black.image.pixels.iter().enumerate() {
            let found = view.image.pixels[i];
            assert!((0..3).all(|c| (found[c] - light[c]).abs() < 0.01), "{found:?}, {light:?}");
        }
    }
}

/// The largest difference between the backgrounds of the first view and of the last one where they
/// have the same direction, in steps of 8 bits.
fn difference_by_direction(dataset: &Dataset) -> f32 {
    let (first, rolled) = (&dataset.train[0], &dataset.train[3]);
    let mut largest = 0f32;
    for y in 0..SIZE {
        for x in 0..SIZE {
            let u = glam::DVec2::new(x as f64, y as f64) + 0.5;
            let direction = first.camera.direction(u);
            let at = rolled.camera.project(rolled.camera.eye + direction).unwrap();
            assert!((at - at.floor() - 0.5).length() < 1e-6, "{at}: a pixel's centre");
            let (i, j) = (y * SIZE + x, at.y as usize * SIZE + at.x as usize);
            if mask(first)[i] == 0.0 && mask(rolled)[j] == 0.0 {
                let (a, b) = (bytes(first, i), bytes(rolled, j));
                largest = (0..3).fold(largest, |l, c| l.max((a[c] - b[c]).abs()));
            }
        }
    }
    largest
}

#[test]
fn the_panorama_is_a_function_of_the_direction_and_noise_is_not() {
    let renders = Renders::new();
    let panorama = renders.compose(Kind::Panorama, 1, "panorama").dataset;
    assert!(difference_by_direction(&panorama) < 1.01, "{}", difference_by_direction(&panorama));
    let noise = renders.compose(Kind::Noise, 1, "noise").dataset;
    assert!(difference_by_direction(&noise) > 100.0);
    for dataset in [&panorama, &noise] {
        // By position on the film, no two views agree.
        for other in 1..4 {
            let uncovered: Vec<usize> = (0..SIZE * SIZE)
                .filter(|i| [0, other].iter().all(|n| mask(&dataset.train[*n])[*i] == 0.0))
                .collect();
            let off =
                |i: &usize| (bytes(&dataset.train[0], *i)[0], bytes(&dataset.train[other], *i)[0]);
            let mean = uncovered.iter().map(off).map(|(a, b)| (a - b).abs()).sum::<f32>();
            assert!(mean / uncovered.len() as f32 > 30.0, "view {other}: {mean}");
        }
    }
}

#[test]
fn the_backdrop_of_a_turntable_stands_still_in_the_image() {
    let renders = Renders::new();
    let source = loaded(&renders.source());
    let made = renders.compose(Kind::Turntable, 4, "turntable").dataset;
    let views = |d: &Dataset| [&d.train[..], &d.test[..]].concat();
    let (made, source) = (views(&made), views(&source));
    let is_free = |i: &usize| source.iter().all(|view| view.coverage().unwrap()[*i] == 0.0);
    let free: Vec<usize> = (0..SIZE * SIZE).filter(is_free).collect();
    assert!(free.len() > 50, "{}", free.len());
    let of_view = |view: &View| free.iter().map(|i| view.image.pixels[*i]).collect::<Vec<_>>();
    let first = of_view(&made[0]);
    assert!(made.iter().all(|view| of_view(view) == first));
    assert!(first.windows(2).filter(|pair| pair[0] != pair[1]).count() > free.len() / 4);
}

#[test]
fn a_seed_decides_all_files() {
    let renders = Renders::new();
    let file = |kind, seed, name: &str| {
        let folder = renders.compose(kind, seed, name).folder;
        std::fs::read(folder.join("train/r_001.png")).unwrap()
    };
    let kinds = [Kind::Panorama, Kind::Noise, Kind::GreyExposure, Kind::PerView];
    for kind in [&kinds[..], &[Kind::Turntable, Kind::TurntableNoise]].concat() {
        let at = |seed, name: &str| file(kind, seed, &format!("{kind:?}-{name}"));
        let first = at(5, "first");
        assert!(first == at(5, "again") && first != at(6, "other"), "{kind:?}");
    }
}

#[test]
fn wrong_sources_and_full_folders_are_refused() {
    let renders = Renders::new();
    let refused = |source: &Path, name: &str, words: &[&str]| {
        let folder = renders.folder.path().join(name);
        let error = compose(Kind::Black, source, &folder, 0, &mut |_| {}).unwrap_err();
        assert!(error.input().is_some(), "{error}");
        let message = error.to_string();
        assert!(words.iter().all(|w| message.contains(w)), "no {words:?} in {message}");
    };
    let source = renders.source();
    refused(&source, "data", &["data: output", "new or empty"]);
    refused(&renders.folder.path().join("none"), "new", &["none"]);
    let path = source.join("train/r_001.png");
    let mut image = image::open(&path).unwrap().into_rgb8();
    image.enumerate_pixels_mut().filter(|(x, ..)| *x < 4).for_each(|(.., p)| p.0 = [0; 3]);
    image.save(&path).unwrap();
    refused(&source, "new", &["background", "one colour"]);
    std::fs::remove_file(source.join("masks/test/r_000.png")).unwrap();
    refused(&source, "new", &["test/r_000.png: mask", "alpha channel"]);
    assert!(!renders.folder.path().join("new").exists());
}
