//! Small data sets in every format, written here and read back, and everything that can be wrong
//! with them.

use std::fs::File;
use std::path::{Path, PathBuf};

use approx::assert_relative_eq;
use field::Sphere;
use glam::{DMat3, DVec2};
use npyz::WriterBuilder;
use serde_json::{Value, json};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::*;
use io::write_image;

pub(super) const WIDTH: u32 = 48;
pub(super) const HEIGHT: u32 = 40;
const BACKGROUND: [f32; 3] = [0.05, 0.1, 0.2];

/// The one object there is.
pub(super) fn ball() -> Sphere<f64> {
    Sphere { center: DVec3::new(0.2, -0.1, 0.3), radius: 0.5 }
}

/// Cameras all around the ball, not quite aimed at it.
pub(super) fn cameras(count: usize) -> Vec<Camera> {
    let (focal, principal) = (DVec2::new(90.0, 88.0), DVec2::new(23.0, 21.5));
    (0..count)
        .map(|i| {
            let (azimuth, height) = (2.4 * i as f64, (1.7 * i as f64).sin());
            let eye =
                ball().center + 3.0 * DVec3::new(azimuth.cos(), azimuth.sin(), height).normalize();
            let target =
                ball().center + 0.05 * DVec3::new((3.0 * azimuth).sin(), azimuth.cos(), 0.0);
            Camera::look_at(WIDTH, HEIGHT, focal, principal, eye, target, DVec3::Z).unwrap()
        })
        .collect()
}

/// The ball seen by a camera: bright, coloured by where it is hit.
pub(super) fn photograph(camera: &Camera) -> Film {
    let mut film = Film::new(camera.width, camera.height);
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        let u = DVec2::new(
            f64::from(i as u32 % camera.width) + 0.5,
            f64::from(i as u32 / camera.width) + 0.5,
        );
        let direction = camera.direction(u);
        *pixel = match ball().clip(camera.eye, direction) {
            Some((t, _)) => {
                let n = (camera.eye + direction * t - ball().center) / ball().radius;
                (n * 0.3 + 0.6).as_vec3().to_array()
            }
            None => BACKGROUND,
        };
    }
    film
}

pub(super) fn same_camera(found: &Camera, expected: &Camera, tolerance: f64) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    assert_relative_eq!(found.focal, expected.focal, max_relative = tolerance);
    assert_relative_eq!(found.principal, expected.principal, epsilon = 100.0 * tolerance);
    for (a, b) in [
        (found.eye, expected.eye),
        (found.right, expected.right),
        (found.up, expected.up),
        (found.forward, expected.forward),
    ] {
        assert_relative_eq!(a, b, epsilon = 10.0 * tolerance);
    }
}

/// The error of a data set that must not load: wrong input, on one line, with these words.
pub(super) fn refused(path: &Path, words: &[&str]) {
    let error = load(path, &LoadOptions::default()).expect_err("a data set that is wrong");
    let text = error.to_string();
    assert!(error.is::<InputError>(), "{text}");
    assert!(!text.contains('\n'), "{text}");
    for word in words {
        assert!(text.contains(word), "no {word:?} in: {text}");
    }
}

fn rows(m: DMat4) -> Vec<[f64; 4]> {
    m.transpose().to_cols_array_2d().to_vec()
}

/// `transforms_train.json` (or another name) and its images.
fn write_nerf(folder: &Path, file: &str, cameras: &[Camera]) -> Value {
    let frames: Vec<Value> = cameras
        .iter()
        .enumerate()
        .map(|(i, camera)| {
            let name = format!("{}_{i}", file.trim_end_matches(".json"));
            write_image(&folder.join(format!("{name}.png")), &photograph(camera)).unwrap();
            json!({"file_path": format!("./{name}"), "transform_matrix": rows(camera.pose())})
        })
        .collect();
    let c = &cameras[0];
    let root = json!({"fl_x": c.focal.x, "fl_y": c.focal.y, "cx": c.principal.x, "cy": c.principal.y,
        "w": c.width, "h": c.height, "frames": frames});
    write_json(&folder.join(file), &root);
    root
}

fn write_json(path: &Path, value: &Value) {
    std::fs::write(path, value.to_string()).unwrap();
}

/// Every third array is stored by columns.
fn write_npz(folder: &Path, arrays: &[(String, DMat4)]) {
    let mut npz = ZipWriter::new(File::create(folder.join("cameras_sphere.npz")).unwrap());
    for (i, (name, matrix)) in arrays.iter().enumerate() {
        npz.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        let (order, stored) = match i % 3 {
            2 => (npyz::Order::Fortran, *matrix),
            _ => (npyz::Order::C, matrix.transpose()),
        };
        let options = npyz::WriteOptions::new().default_dtype().shape(&[4, 4]).order(order);
        let mut array = options.writer(&mut npz).begin_nd().unwrap();
        array.extend(stored.to_cols_array()).unwrap();
        array.finish().unwrap();
    }
    npz.finish().unwrap();
}

/// The world-to-camera rotation and translation, axes x right, y down, z forward.
pub(super) fn world_to_camera(c: &Camera) -> (DMat3, DVec3) {
    let r = DMat3::from_cols(c.right, -c.up, c.forward).transpose();
    (r, -(r * c.eye))
}

fn write_neus(folder: &Path, cameras: &[Camera]) -> Vec<(String, DMat4)> {
    let mut arrays = Vec::new();
    for sub in ["image", "mask"] {
        std::fs::create_dir(folder.join(sub)).unwrap();
    }
    for (i, c) in cameras.iter().enumerate() {
        let film = photograph(c);
        write_image(&folder.join(format!("image/{i:03}.png")), &film).unwrap();
        let white =
            film.pixels.iter().map(|p| [f32::from(u8::from(*p != BACKGROUND)); 3]).collect();
        write_image(&folder.join(format!("mask/{i:03}.png")), &Film { pixels: white, ..film })
            .unwrap();
        let (r, t) = world_to_camera(c);
        let p = c.principal - 0.5;
        let k = DMat3::from_cols(DVec3::X * c.focal.x, DVec3::Y * c.focal.y, p.extend(1.0));
        let mut world = DMat4::from_mat3(k * r);
        world.w_axis = (k * t).extend(1.0);
        arrays.push((format!("world_mat_{i}"), world));
        let scale = DMat4::from_translation(ball().center) * DMat4::from_scale(DVec3::splat(0.7));
        arrays.push((format!("scale_mat_{i}"), scale));
    }
    write_npz(folder, &arrays);
    arrays
}

fn middlebury_line(name: &str, c: &Camera, skew: f64) -> String {
    let (r, t) = world_to_camera(c);
    let k = [c.focal.x, skew, c.principal.x, 0.0, c.focal.y, c.principal.y, 0.0, 0.0, 1.0];
    let numbers = k.into_iter().chain(r.transpose().to_cols_array()).chain(t.to_array());
    format!("{name} {}", numbers.map(|v| format!("{v:.12}")).collect::<Vec<_>>().join(" "))
}

fn write_middlebury(folder: &Path, cameras: &[Camera]) -> PathBuf {
    let lines = cameras.iter().enumerate().map(|(i, c)| {
        let name = format!("ball{i:04}.png");
        write_image(&folder.join(&name), &photograph(c)).unwrap();
        middlebury_line(&name, c, 0.0)
    });
    let text = format!("{}\n{}\n", cameras.len(), lines.collect::<Vec<_>>().join("\n"));
    let path = folder.join("ball_par.txt");
    std::fs::write(&path, text).unwrap();
    path
}

/// Views 0, 8, … are held out, the others are fitted.
pub(super) fn in_order(dataset: &Dataset) -> Vec<&View> {
    let (mut train, mut test) = (dataset.train.iter(), dataset.test.iter());
    let count = dataset.train.len() + dataset.test.len();
    (0..count).map(|i| if i % 8 == 0 { test.next() } else { train.next() }.unwrap()).collect()
}

#[test]
fn nerf_sets_are_read_with_their_own_split() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(6);
    write_nerf(folder.path(), "transforms_train.json", &all[..4]);
    write_nerf(folder.path(), "transforms_val.json", &all[4..5]);
    for path in [folder.path().to_owned(), folder.path().join("transforms_train.json")] {
        let dataset = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!((dataset.train.len(), dataset.test.len()), (4, 1));
        for (view, camera) in dataset.train.iter().chain(&dataset.test).zip(&all) {
            same_camera(&view.camera, camera, 1e-12);
        }
    }
    // A test set goes before a validation set.
    write_nerf(folder.path(), "transforms_test.json", &all[4..]);
    assert_eq!(load(folder.path(), &LoadOptions::default()).unwrap().test.len(), 2);
}

#[test]
fn nerf_focal_lengths_come_from_the_angle_where_nothing_else_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(9));
    for key in ["fl_x", "fl_y", "cx", "cy", "w", "h"] {
        root.as_object_mut().unwrap().remove(key);
    }
    root["camera_angle_x"] = json!(0.6);
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.train.len(), dataset.test.len()), (7, 2));
    let camera = dataset.train[0].camera;
    assert_relative_eq!(camera.focal, DVec2::splat(24.0 / 0.3f64.tan()), epsilon = 1e-12);
    assert_eq!(camera.principal, DVec2::new(24.0, 20.0));
}

#[test]
fn images_are_averaged_in_linear_light() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(2));
    let whole = load(folder.path(), &LoadOptions { downscale: 1 }).unwrap();
    let half = load(folder.path(), &LoadOptions { downscale: 2 }).unwrap();
    let (a, b) = (&whole.train[0], &half.train[0]);
    assert_eq!((b.camera.width, b.camera.height), (24, 20));
    let mean = (0..3).map(|c| {
        [(10, 8), (11, 8), (10, 9), (11, 9)].map(|(x, y)| a.image.at(x, y)[c]).iter().sum::<f32>()
            / 4.0
    });
    for (mean, found) in mean.zip(b.image.at(5, 4)) {
        assert_relative_eq!(mean, found, epsilon = 1e-6);
    }
    let u = DVec2::new(11.5, 17.0);
    assert_relative_eq!(a.camera.direction(u), b.camera.direction(u / 2.0), epsilon = 1e-12);
    assert!(load(folder.path(), &LoadOptions { downscale: 0 }).is_err());
}

#[test]
fn masks_come_from_alpha_a_key_or_a_folder_of_masks() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let mut rgba = image::RgbaImage::from_pixel(WIDTH, HEIGHT, image::Rgba([255, 255, 255, 0]));
    rgba.put_pixel(3, 2, image::Rgba([255, 255, 255, 255]));
    rgba.save(folder.path().join("transforms_0.png")).unwrap();
    let grey = image::GrayImage::from_pixel(WIDTH, HEIGHT, image::Luma([128]));
    grey.save(folder.path().join("white.png")).unwrap();
    root["frames"][1]["mask_path"] = json!("white.png");
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    image::GrayImage::new(WIDTH, HEIGHT)
        .save(folder.path().join("masks/transforms_2.png"))
        .unwrap();
    let path = folder.path().join("transforms.json");
    write_json(&path, &root);
    let dataset = load(&path, &LoadOptions::default()).unwrap();
    let views = in_order(&dataset);
    let masks: Vec<&Vec<f32>> = views.iter().map(|v| v.mask.as_ref().unwrap()).collect();
    assert_eq!((masks[0][0], masks[0][2 * WIDTH as usize + 3]), (0.0, 1.0));
    assert_eq!((views[0].image.at(0, 0), views[0].image.at(3, 2)), ([0.0; 3], [1.0; 3]));
    assert_relative_eq!(masks[1][7], 128.0 / 255.0, epsilon = 1e-5);
    assert_eq!(masks[2][7], 0.0);
    root["frames"][1]["mask_path"] = json!("none.png");
    write_json(&path, &root);
    refused(&path, &["none.png", "no such file"]);
}

#[test]
fn neus_sets_are_read_in_world_units() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_neus(folder.path(), &all);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let bounds = dataset.bounds.unwrap();
    assert_relative_eq!(bounds.center, ball().center, epsilon = 1e-12);
    assert_relative_eq!(bounds.radius, 0.7, epsilon = 1e-12);
    for (view, camera) in in_order(&dataset).into_iter().zip(&all) {
        same_camera(&view.camera, camera, 1e-9);
        let mask = view.mask.as_ref().unwrap();
        let film = photograph(camera);
        let covered = film.pixels.iter().map(|p| f32::from(u8::from(*p != BACKGROUND)));
        assert!(mask.iter().zip(covered).all(|(m, c)| (m - c).abs() < 1e-5));
    }
}

#[test]
fn neus_archives_that_are_wrong_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let arrays = write_neus(folder.path(), &cameras(3));
    let with = |name: &str, change: &dyn Fn(DMat4) -> DMat4| {
        let changed =
            |(n, m): &(String, DMat4)| (n.clone(), if n == name { change(*m) } else { *m });
        write_npz(folder.path(), &arrays.iter().map(changed).collect::<Vec<_>>());
    };
    with("world_mat_1", &|_| DMat4::ZERO);
    refused(folder.path(), &["cameras_sphere.npz", "world_mat_1", "singular"]);
    with("world_mat_2", &|_| DMat4::NAN);
    refused(folder.path(), &["world_mat_2", "not finite"]);
    with("scale_mat_0", &|m| m * DMat4::from_scale(DVec3::new(1.0, 2.0, 1.0)));
    refused(folder.path(), &["scale_mat_0", "uniform scale"]);
    write_npz(folder.path(), &arrays[..4]);
    refused(folder.path(), &["world_mat_*", "2 arrays", "3, one for each image"]);
    let without: Vec<_> = arrays.iter().filter(|(n, _)| n != "scale_mat_1").cloned().collect();
    write_npz(folder.path(), &without);
    refused(folder.path(), &["scale_mat_1", "nothing"]);
    std::fs::write(folder.path().join("cameras_sphere.npz"), "no archive").unwrap();
    refused(folder.path(), &["cameras_sphere.npz", ".npz"]);
}

#[test]
fn middlebury_sets_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    let file = write_middlebury(folder.path(), &all);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    for (view, camera) in in_order(&dataset).into_iter().zip(&all) {
        same_camera(&view.camera, camera, 1e-9);
    }
    let good = std::fs::read_to_string(&file).unwrap();
    let line = middlebury_line("ball0000.png", &all[0], 0.0);
    let with = |other: &str| std::fs::write(&file, good.replace(&line, other)).unwrap();
    with("ball0000.png 1 2 3");
    refused(folder.path(), &["ball_par.txt", "line 2", "3 numbers"]);
    with(&line.replacen("90.000000000000", "nan", 1));
    refused(folder.path(), &["line 2", "number 1 that is not finite"]);
    with(&line.replacen("90.000000000000", "0", 1));
    refused(folder.path(), &["line 2", "singular K", "fx and fy above 0"]);
    let stretched = line.split(' ').enumerate().map(|(i, w)| if i == 10 { "1.5" } else { w });
    with(&stretched.collect::<Vec<_>>().join(" "));
    refused(folder.path(), &["line 2", "R with columns of length"]);
    with(&line.replace("ball0000", "absent"));
    refused(folder.path(), &["absent.png", "no such file"]);
    std::fs::write(&file, good.replacen('9', "8", 1)).unwrap();
    refused(folder.path(), &["views", "found 9", "expected 8"]);
    std::fs::write(&file, "0\n").unwrap();
    refused(folder.path(), &["views"]);
}

#[test]
fn skew_is_taken_out_of_the_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(2);
    let file = write_middlebury(folder.path(), &all);
    let lines: Vec<String> =
        (0..2).map(|i| middlebury_line(&format!("ball000{i}.png"), &all[i], 8.0)).collect();
    std::fs::write(&file, format!("2\n{}\n", lines.join("\n"))).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let view = &dataset.train[0];
    // A point that a camera with skew photographs at `at` belongs, without skew, 8 tan(y) to the
    // left.
    let y = (10.5 - all[0].principal.y) / all[0].focal.y;
    let zoom = view.camera.focal.x / all[0].focal.x;
    let at = DVec2::new(20.5, 10.5) - DVec2::new(8.0 * y, 0.0) - all[0].principal;
    assert!((1.0..1.2).contains(&zoom), "{zoom}");
    assert_relative_eq!(
        view.camera.direction(at * zoom + view.camera.principal),
        all[0].direction(DVec2::new(20.5, 10.5) - DVec2::new(8.0 * y, 0.0)),
        epsilon = 1e-12
    );
    assert_ne!(view.image, photograph(&all[0]));
}

#[test]
fn wrong_transforms_name_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let good = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms.json");
    let with = |pointer: &str, value: Value| {
        let mut root = good.clone();
        match root.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => root[&pointer[1..]] = value,
        }
        write_json(&path, &root);
    };
    let cases = [
        ("/frames", json!([]), vec!["frames", "found []"]),
        ("/frames", json!(3), vec!["frames", "found 3"]),
        ("/frames/1/file_path", json!(7), vec!["frames/1/file_path", "found 7"]),
        ("/frames/1/file_path", json!("gone"), vec!["gone", "no such file", "frames/1"]),
        (
            "/frames/2/transform_matrix",
            json!([[1, 2], [3, 4]]),
            vec!["frames/2/transform_matrix", "4 x 4"],
        ),
        (
            "/frames/2/transform_matrix/0/0",
            json!("x"),
            vec!["frames/2/transform_matrix", "finite numbers"],
        ),
        (
            "/frames/2/transform_matrix/0/0",
            json!(9),
            vec!["frames/2/transform_matrix", "determinant", "rotation"],
        ),
        (
            "/frames/2/transform_matrix/3",
            json!([1, 2, 3, 1]),
            vec!["frames/2/transform_matrix", "last row"],
        ),
        (
            "/w",
            json!(50),
            vec!["transforms_1.png", "found 48 x 40", "expected 50 x 40, as transforms.json says"],
        ),
        ("/w", json!(-48), vec!["w:", "found -48"]),
        ("/w", json!("wide"), vec!["w:", "found \"wide\"", "a finite number"]),
        ("/fl_x", json!(0), vec!["fl_x", "focal lengths 0"]),
        ("/is_fisheye", json!(true), vec!["is_fisheye"]),
        ("/camera_model", json!("EQUIRECTANGULAR"), vec!["camera_model", "EQUIRECTANGULAR"]),
        ("/k3", json!(0.1), vec!["k3", "found 0.1"]),
        ("/k1", json!(-40), vec!["distortion"]),
    ];
    for (pointer, value, words) in cases {
        with(pointer, value);
        refused(&path, &words);
    }
    std::fs::write(&path, "{\"frames\": [\n  {\"file_path\": NaN}]}").unwrap();
    refused(&path, &["transforms.json", "line 2 column"]);
    std::fs::write(&path, "{\"frames\": [{\"a\": 1e999}]}").unwrap();
    refused(&path, &["line 1 column"]);
}

#[test]
fn distortion_is_taken_out_of_the_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    root["k1"] = json!(0.3);
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let view = in_order(&dataset)[0];
    assert!(
        view.camera.focal.x > 90.0,
        "pincushion images lose their border: {}",
        view.camera.focal
    );
    assert_ne!(view.image, photograph(&cameras(1)[0]));
}

#[test]
fn images_that_are_missing_cut_or_no_images_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms_1.png");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    refused(folder.path(), &["transforms_1.png", "cut short"]);
    std::fs::write(&path, "words").unwrap();
    refused(folder.path(), &["transforms_1.png", "no image"]);
    std::fs::remove_file(&path).unwrap();
    refused(folder.path(), &["transforms_1", "no such file"]);
}

#[test]
fn folders_without_cameras_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    refused(folder.path(), &["no camera file", "transforms.json", "COLMAP"]);
    refused(&folder.path().join("nowhere"), &["nowhere"]);
}

#[test]
fn cameras_inside_the_bounding_sphere_or_turned_away_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_nerf(folder.path(), "transforms.json", &cameras(9));
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(check_cameras(&dataset, &ball()).is_ok());
    let turned = |count: usize| {
        let mut turned = dataset.clone();
        for view in turned.train.iter_mut().take(count) {
            // The same pose with y down and z forward, as OpenCV has it.
            view.camera.up = -view.camera.up;
            view.camera.forward = -view.camera.forward;
        }
        check_cameras(&turned, &ball())
    };
    assert!(turned(4).is_ok());
    let error = turned(7).unwrap_err().to_string();
    assert!(error.contains("7 of 9 cameras look away") && error.contains("OpenCV"), "{error}");
    let error = check_cameras(&dataset, &ball().scaled(7.0)).unwrap_err().to_string();
    assert!(error.contains("3.0000 from the centre") && error.contains("--bounds"), "{error}");
}

#[test]
fn the_ball_and_its_background_are_found() {
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
    // What was asked for is taken as it is.
    assert_eq!(surroundings(&dataset, Some(ball())).0, ball());
}
