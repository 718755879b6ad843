//! What people's files are like: one row a case, for every form in which it can occur. A row says
//! that a set is read, with which note, or refused, with which words.

use std::fs;

use super::colmap::write_text;
use super::forms::{World, centred, metashape, poses_bounds, write_array, write_cams};
use super::forms::{resized, write_photographs};
use super::middlebury::middlebury_line;
use super::neus::write_neus;
use super::*;

/// Views of each set.
const VIEWS: usize = 9;

/// A form of data set.
struct Form {
    name: &'static str,
    /// Writes a set of [`VIEWS`] photographs `000.png`, … in [`Form::images`].
    write: fn(&Path, &[Camera]),
    /// The folder of the photographs.
    images: &'static str,
    /// Whether the camera file states the size of the photographs.
    states_size: bool,
}

const FORMS: [Form; 7] = [
    Form { name: "NeRF", write: nerf, images: "images", states_size: true },
    Form { name: "COLMAP", write: colmap, images: "images", states_size: true },
    Form { name: "LLFF", write: llff, images: "images", states_size: true },
    Form { name: "BlendedMVS", write: cams, images: "blended_images", states_size: false },
    Form { name: "Metashape", write: agisoft, images: "images", states_size: true },
    Form { name: "Middlebury", write: middlebury, images: "", states_size: false },
    Form { name: "NeuS", write: neus, images: "image", states_size: false },
];

fn nerf(folder: &Path, cameras: &[Camera]) {
    write_photographs(&folder.join("images"), cameras, [WIDTH, HEIGHT]);
    let frame = |(i, camera): (usize, &Camera)| json!({"file_path": format!("images/{i:03}.png"), "transform_matrix": rows(camera.pose())});
    let c = &cameras[0];
    let frames: Vec<Value> = cameras.iter().enumerate().map(frame).collect();
    let root = json!({
        "fl_x": c.focal.x, "fl_y": c.focal.y, "cx": c.principal.x, "cy": c.principal.y,
        "w": c.width, "h": c.height, "frames": frames,
    });
    write_json(&folder.join("transforms.json"), &root);
}

fn colmap(folder: &Path, cameras: &[Camera]) {
    write_photographs(&folder.join("images"), cameras, [WIDTH, HEIGHT]);
    let c = &cameras[0];
    let numbers = [c.focal.x, c.focal.y, c.principal.x, c.principal.y];
    write_text(&folder.join("sparse/0"), cameras, "PINHOLE", &numbers);
    edit(&folder.join("sparse/0/images.txt"), |text| {
        (0..cameras.len())
            .fold(text, |text, i| text.replace(&format!("{i:02} a.png"), &format!("{i:03}.png")))
    });
}

fn llff(folder: &Path, cameras: &[Camera]) {
    write_photographs(&folder.join("images"), cameras, [WIDTH, HEIGHT]);
    let shape = [cameras.len() as u64, 17];
    write_array(&folder.join("poses_bounds.npy"), &shape, &poses_bounds(cameras));
}

fn cams(folder: &Path, cameras: &[Camera]) {
    write_cams(folder, cameras, "blended_images");
}

fn agisoft(folder: &Path, cameras: &[Camera]) {
    write_photographs(&folder.join("images"), cameras, [WIDTH, HEIGHT]);
    let world = World { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };
    let text = metashape(cameras, &world, false);
    let unaligned = "<camera id=\"99\" sensor_id=\"0\" label=\"blurred\"/>";
    fs::write(folder.join("cameras.xml"), text.replace(unaligned, "")).unwrap();
}

fn middlebury(folder: &Path, cameras: &[Camera]) {
    write_photographs(folder, cameras, [WIDTH, HEIGHT]);
    let line = |(i, c): (usize, &Camera)| middlebury_line(&format!("{i:03}.png"), c, 0.0);
    let lines: Vec<String> = cameras.iter().enumerate().map(line).collect();
    let text = format!("{}\n{}\n", cameras.len(), lines.join("\n"));
    fs::write(folder.join("ball_par.txt"), text).unwrap();
}

fn neus(folder: &Path, cameras: &[Camera]) {
    write_neus(folder, cameras);
    fs::remove_dir_all(folder.join("mask")).unwrap();
}

fn edit(path: &Path, change: impl Fn(String) -> String) {
    fs::write(path, change(fs::read_to_string(path).unwrap())).unwrap();
}

/// Writes a set of this form; returns its folder and the cameras.
fn written(form: &Form) -> (tempfile::TempDir, Vec<Camera>) {
    let folder = tempfile::tempdir().unwrap();
    let all = centred(VIEWS);
    (form.write)(folder.path(), &all);
    (folder, all)
}

/// Reads a set that has these cameras, in order; the notes must have these words.
fn read(form: &Form, row: &str, folder: &Path, cameras: &[Camera], words: &[&str]) -> Dataset {
    let place = format!("{}, {row}", form.name);
    let dataset = load(folder, &LoadOptions::default()).unwrap_or_else(|e| panic!("{place}: {e}"));
    let views = in_order(&dataset);
    assert_eq!(views.len(), cameras.len(), "{place}");
    for (view, camera) in views.iter().zip(cameras) {
        assert!((view.camera.eye - camera.eye).length() < 1e-6, "{place}: {}", view.name);
        assert!((view.camera.forward - camera.forward).length() < 1e-6, "{place}: {}", view.name);
        assert!((view.camera.focal - camera.focal).length() < 1e-6, "{place}: {}", view.name);
        assert_shows(view, camera, &place);
    }
    let notes = dataset.notes.join("\n");
    assert!(words.is_empty() == notes.is_empty(), "{place}: {notes}");
    words.iter().for_each(|word| assert!(notes.contains(word), "{place}: no {word} in {notes}"));
    dataset
}

/// Whether a view has the photograph of a camera, up to 8 bits.
fn assert_shows(view: &View, camera: &Camera, place: &str) {
    let expected = photograph(camera);
    assert_eq!(view.image.pixels.len(), expected.pixels.len(), "{place}: {}", view.name);
    let near = |(a, b): (&f32, &f32)| (a - b).abs() < 0.02;
    let mut pairs = view.image.pixels.as_flattened().iter().zip(expected.pixels.as_flattened());
    assert!(pairs.all(near), "{place}: another photograph for {}", view.name);
}

/// Writes an image of the ball's coverage, white on black.
fn write_mask(path: &Path, camera: &Camera, is_inverted: bool) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let film = photograph(camera);
    let is_white = |pixel: &[f32; 3]| (*pixel != BACKGROUND) != is_inverted;
    let values: Vec<u8> = film.pixels.iter().map(|p| 255 * u8::from(is_white(p))).collect();
    let image = image::GrayImage::from_raw(film.width, film.height, values).unwrap();
    let is_jpeg = ["jpg", "jpeg"].contains(&files::extension(path).as_str());
    let format = if is_jpeg { image::ImageFormat::Jpeg } else { image::ImageFormat::Png };
    image.save_with_format(path, format).unwrap();
}

/// Whether a mask is that of the ball, up to the losses of JPEG.
fn assert_is_of_ball(view: &View, camera: &Camera, row: &str) {
    let mask = view.mask.as_ref().unwrap_or_else(|| panic!("{row}: no mask of {}", view.name));
    let expected = photograph(camera);
    let wrong = mask.values.iter().zip(&expected.pixels);
    let wrong = wrong.filter(|(v, p)| (**v > 0.5) != (**p != BACKGROUND)).count();
    assert!(wrong <= mask.values.len() / 30, "{row}: {wrong} pixels of {}", view.name);
}

#[test]
fn masks_are_found_wherever_people_put_them() {
    use MaskKind::{Object, Used};
    // `@` is the folder of the photographs, and `#` their name without the extension.
    let rows = [
        ("masks/#.png", Object, ""),
        ("masks/#.PNG", Object, ""),
        ("masks/#.jpg", Object, ""),
        ("Masks/#.png", Object, ""),
        ("mask/#.png", Object, ""),
        ("MASK/#.JPEG", Object, ""),
        ("object_masks/#.png", Object, ""),
        ("masks/#_mask.png", Object, ""),
        ("masks/mask_#.png", Object, ""),
        ("masks/@/#.png", Object, ""),
        ("@/#_mask.png", Object, ""),
        ("@/#.mask.png", Object, ""),
        ("@/#-Mask.jpg", Object, ""),
        ("@/mask_#.png", Object, ""),
        ("@/masks/#.png", Object, ""),
        ("@/dynamic_mask_#.png", Object, "taken as the object"),
        ("dynamic_masks/#.png", Object, "taken as the object"),
        ("masks/view #.png", Object, "by their numbers"),
        ("masks_2/#.png", Object, ""),
        ("silhouettes/#.png", Object, ""),
        ("@/#mask.png", Object, ""),
        ("@/mask#.png", Object, ""),
        ("@/#_mask1.png", Object, ""),
        ("data/masks/#.png", Object, ""),
    ];
    for form in &FORMS {
        for (pattern, kind, note) in rows {
            let (folder, all) = written(form);
            let place =
                pattern.replace('@', if form.images.is_empty() { "." } else { form.images });
            for (i, camera) in all.iter().enumerate() {
                let name = place.replace('#', &format!("{i:03}"));
                write_mask(&folder.path().join(name), camera, false);
            }
            let words: Vec<&str> = Some(note).into_iter().filter(|n| !n.is_empty()).collect();
            let found = read(form, pattern, folder.path(), &all, &words);
            for (view, camera) in in_order(&found).into_iter().zip(&all) {
                assert_is_of_ball(view, camera, &format!("{}, {pattern}", form.name));
                assert_eq!(view.mask.as_ref().unwrap().kind, kind);
            }
        }
        // COLMAP's own naming: pixels to use. Elsewhere a mask of the object.
        let (folder, all) = written(form);
        for (i, camera) in all.iter().enumerate() {
            write_mask(&folder.path().join(format!("Masks/{i:03}.png.PNG")), camera, false);
        }
        let found = read(form, "Masks/#.png.PNG", folder.path(), &all, &[]);
        let kind = if form.name == "COLMAP" { Used } else { Object };
        assert!(found.train.iter().all(|view| view.mask.as_ref().unwrap().kind == kind));
        // instant-ngp leaves the white pixels of dynamic masks out.
        let (folder, all) = written(form);
        for (i, camera) in all.iter().enumerate() {
            let path = folder.path().join(form.images).join(format!("dynamic_mask_{i:03}.png"));
            write_mask(&path, camera, true);
        }
        let found = read(form, "dynamic", folder.path(), &all, &["are left out"]);
        assert_is_of_ball(&found.train[4], &all[4], form.name);
        assert_eq!(found.train[4].mask.as_ref().unwrap().kind, Used);
    }
}

#[test]
fn files_that_look_like_masks_and_fit_no_photograph_are_named() {
    for form in &FORMS {
        let (folder, all) = written(form);
        write_mask(&folder.path().join("masks/000.png"), &all[0], false);
        write_mask(&folder.path().join("masks/other.png"), &all[0], false);
        let words = ["1 file looks like a mask, for no photograph that is here: masks/other.png"];
        let found = read(form, "other", folder.path(), &all, &words);
        assert_eq!(found.train.iter().filter(|view| view.mask.is_some()).count(), 1);
        // A second folder of masks.
        fs::remove_file(folder.path().join("masks/other.png")).unwrap();
        write_mask(&folder.path().join("masks_sam/000.png"), &all[0], false);
        read(form, "two", folder.path(), &all, &["others come first: masks_sam/000.png"]);
        // A format that is not read.
        let (folder, all) = written(form);
        write_mask(&folder.path().join("masks/000.png"), &all[0], false);
        fs::rename(folder.path().join("masks/000.png"), folder.path().join("masks/000.bmp"))
            .unwrap();
        let words = ["1 file looks like a mask, in a format that is not read: masks/000.bmp"];
        read(form, "bmp", folder.path(), &all, &words);
    }
}

#[test]
fn a_bare_name_serves_one_photograph_only() {
    let folder = tempfile::tempdir().unwrap();
    let all = centred(VIEWS);
    nerf(folder.path(), &all);
    let at = |name: &str| folder.path().join(name);
    let name = |i: usize| format!("{}/r_{:03}.png", ["train", "test"][i % 2], i / 2);
    for (i, camera) in all.iter().enumerate() {
        fs::create_dir_all(at(&name(i)).parent().unwrap()).unwrap();
        fs::rename(at(&format!("images/{i:03}.png")), at(&name(i))).unwrap();
        edit(&at("transforms.json"), |t| t.replace(&format!("images/{i:03}.png"), &name(i)));
        write_mask(&at(&format!("masks/r_{:03}.png", i / 2)), camera, false);
    }
    let words = [
        "fit several photographs and are not used: 4",
        "masks/r_000.png fits train/r_000.png, test/r_000.png",
    ];
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    let notes = found.notes.join("\n");
    assert!(words.iter().all(|word| notes.contains(word)), "{notes}");
    // The last number is in `train` alone.
    let with_mask = |found: &Dataset| found.train.iter().filter(|v| v.mask.is_some()).count();
    assert_eq!(with_mask(&found), 1);
    // Folders of masks within those of the photographs serve these alone.
    fs::remove_dir_all(at("masks")).unwrap();
    for (i, camera) in all.iter().enumerate() {
        let place = name(i).replace("r_", "masks/r_");
        write_mask(&at(&place), camera, false);
    }
    let found = read(&FORMS[0], "within", folder.path(), &all, &[]);
    assert_eq!(with_mask(&found), VIEWS);
    for place in ["train/masks", "test/masks"] {
        fs::remove_dir_all(at(place)).unwrap();
    }
    // With their folders, all are found.
    for (i, camera) in all.iter().enumerate() {
        write_mask(&at(&format!("masks/{}", name(i))), camera, false);
    }
    let found = read(&FORMS[0], "mirrored", folder.path(), &all, &[]);
    for (view, camera) in found.train.iter().zip(&all) {
        assert_is_of_ball(view, camera, "mirrored");
    }
}

#[test]
fn names_that_are_numbers_are_in_the_order_of_the_numbers() {
    let all = centred(12);
    for form in FORMS.iter().filter(|form| ["NeuS", "LLFF"].contains(&form.name)) {
        // `#` is the number, and that of the first mask is the last column.
        for (image, mask, first) in
            [("v#.png", "m#.png", 0), ("#_v2.png", "#.png", 1), ("cam#_#.png", "cam#_#.png", 0)]
        {
            let folder = tempfile::tempdir().unwrap();
            (form.write)(folder.path(), &all);
            let at = |name: String| folder.path().join(form.images).join(name);
            for (i, camera) in all.iter().enumerate() {
                let own = image.replace('#', &i.to_string());
                fs::rename(at(format!("{i:03}.png")), at(own)).unwrap();
                let own = mask.replace('#', &(i + first).to_string());
                write_mask(&folder.path().join("mask").join(own), camera, false);
            }
            let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
            let words = "images are paired with the cameras by their numbers";
            assert!(dataset.notes.iter().any(|n| n.contains(words)), "{:?}", dataset.notes);
            for (view, camera) in in_order(&dataset).into_iter().zip(&all) {
                assert_same_camera(&view.camera, camera, 1e-9);
                assert_shows(view, camera, form.name);
                // LLFF has no order of its own for masks.
                if first == 0 || form.name == "NeuS" {
                    assert_is_of_ball(view, camera, form.name);
                }
            }
        }
    }
}

#[test]
fn records_of_colmap_need_no_line_of_points() {
    let (folder, all) = written(&FORMS[1]);
    let path = folder.path().join("sparse/0/images.txt");
    let good = fs::read_to_string(&path).unwrap();
    let is_record = |line: &&str| line.ends_with(".png");
    let records: Vec<&str> = good.lines().filter(is_record).collect();
    let texts = [
        records.join("\n"),
        records.join("\r\n\r\n") + "\r\n",
        records.join("\n1 2 3\n") + "\n# end\n",
        records.join("\n# points\n1 2 -1 4 5 6\n"),
        records.join("\n1 2\n").replace(".png", ""),
    ];
    for text in texts {
        fs::write(&path, &text).unwrap();
        read(&FORMS[1], &text[..60], folder.path(), &all, &[]);
    }
    fs::write(&path, records.join("\n").replace("004.png", "a  b.png")).unwrap();
    fs::rename(folder.path().join("images/004.png"), folder.path().join("images/a  b.png"))
        .unwrap();
    assert_eq!(load(folder.path(), &LoadOptions::default()).unwrap().train.len(), VIEWS);
}

#[test]
fn names_of_photographs_are_those_of_other_systems() {
    type Change = fn(&Path, &dyn Fn(&dyn Fn(usize) -> String));
    // Each changes the folder, and the names in the camera file.
    let rows: [(&str, Change); 7] = [
        ("backslashes", |_, rename| rename(&|i| format!("images\\\\{i:03}.png"))),
        ("absolute", |_, rename| rename(&|i| format!("/gone/set/images/{i:03}.png"))),
        ("absolute, Windows", |_, rename| rename(&|i| format!("C:\\\\set\\\\{i:03}.png"))),
        ("a prefix too many", |_, rename| rename(&|i| format!("images/images/{i:03}.png"))),
        ("capitals", |folder, rename| {
            fs::rename(folder.join("images"), folder.join("Images")).unwrap();
            rename(&|i| format!("images/{i:03}.PNG"));
        }),
        ("a companion of macOS", |folder, _| {
            for name in ["._000.png", "images/._000.png", "._transforms.json", "._b_par.txt"] {
                fs::write(folder.join(name), "x").unwrap();
            }
        }),
        ("another extension", |_, rename| rename(&|i| format!("images/{i:03}.tif"))),
    ];
    for form in FORMS.iter().filter(|form| ["NeRF", "COLMAP", "Metashape"].contains(&form.name)) {
        for (row, change) in rows {
            let (folder, all) = written(form);
            let (file, old, is_json): (_, &dyn Fn(usize) -> String, _) = match form.name {
                "NeRF" => ("transforms.json", &|i| format!("images/{i:03}.png"), true),
                "COLMAP" => ("sparse/0/images.txt", &|i| format!("{i:03}.png"), false),
                _ => ("cameras.xml", &|i| format!("label=\"{i:03}\""), false),
            };
            change(folder.path(), &|new| {
                edit(&folder.path().join(file), |text| {
                    (0..VIEWS).fold(text, |text, i| {
                        let name = if is_json { new(i) } else { new(i).replace("\\\\", "\\") };
                        let name = match form.name {
                            "Metashape" => format!("label=\"{name}\""),
                            _ => name,
                        };
                        text.replace(&old(i), &name)
                    })
                });
            });
            read(form, row, folder.path(), &all, &[]);
        }
    }
    // Two photographs of one name, of which one is gone, are not one photograph.
    let (folder, all) = written(&FORMS[0]);
    edit(&folder.path().join("transforms.json"), |t| t.replace("images/003", "other/004"));
    let rest: Vec<Camera> = all[..3].iter().chain(&all[4..]).copied().collect();
    read(&FORMS[0], "a double", folder.path(), &rest, &["other/004.png"]);
}

#[test]
fn poses_that_are_none_are_left_out_and_scales_divided_out() {
    let without: fn(&[Camera]) -> Vec<Camera> = |all| [&all[..1], &all[2..]].concat();
    let (folder, all) = written(&FORMS[0]);
    let file = folder.path().join("transforms.json");
    let good: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    let none = "1 image has no usable pose (null, singular or not finite) and is left out: 001.png";
    for pose in [
        "null",
        "[[NaN, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[1, 0, 0, -Infinity], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]",
        "[[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]",
        "[[1, 0, 0, 1], [0, 1, 0, 1], [1, 1, 0, 2], [0, 0, 0, 1]]",
        "[[null, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
    ] {
        let mut root = good.clone();
        root["frames"][1]["transform_matrix"] = json!("here");
        root["unread"] = json!("NaN");
        let text = root.to_string().replace("\"here\"", pose).replace("\"NaN\"", "NaN");
        fs::write(&file, format!("\u{feff}{text}")).unwrap();
        read(&FORMS[0], pose, folder.path(), &without(&all), &[none]);
    }
    for (scale, shown) in [(1.002, "1.0020"), (0.4, "0.4000"), (1e-7, "1.000e-7")] {
        let mut root = good.clone();
        for (i, camera) in all.iter().enumerate() {
            let pose = camera.pose() * DMat4::from_scale(DVec3::splat(scale));
            root["frames"][i]["transform_matrix"] = json!(rows(pose));
        }
        write_json(&file, &root);
        let word = format!("which is divided out: 9. That of images/000.png has {shown}");
        read(&FORMS[0], "scale", folder.path(), &all, &[&word]);
    }
    for i in 0..6 {
        let mut root = good.clone();
        (0..=i).for_each(|i| root["frames"][i]["transform_matrix"] = Value::Null);
        write_json(&file, &root);
    }
    refused(folder.path(), &["poses", "6 of 9 without a pose", "000.png"]);
    let word = "frames/2/transform_matrix";
    for pose in [json!([[1, 0], [0, 1]]), json!("x"), json!(vec![1.0; 16])] {
        let mut root = good.clone();
        root["frames"][2]["transform_matrix"] = pose;
        write_json(&file, &root);
        refused(folder.path(), &[word]);
    }
}

#[test]
fn every_form_leaves_out_views_without_a_pose() {
    let note = "1 image has no usable pose";
    let number = |camera: &Camera| camera.pose().w_axis.x;
    for form in &FORMS {
        let (folder, mut all) = written(form);
        let nan = Camera { eye: DVec3::NAN, ..all[1] };
        all[1] = nan;
        let other = tempfile::tempdir().unwrap();
        (form.write)(other.path(), &all);
        for file in [
            "transforms.json",
            "sparse/0/images.txt",
            "cams/001_cam.txt",
            "cameras.xml",
            "ball_par.txt",
            "poses_bounds.npy",
            "cameras_sphere.npz",
        ] {
            if other.path().join(file).exists() {
                fs::copy(other.path().join(file), folder.path().join(file)).unwrap();
            }
        }
        let rest = [&all[..1], &all[2..]].concat();
        assert!(rest.iter().all(|camera| number(camera).is_finite()));
        read(form, "NaN", folder.path(), &rest, &[note]);
    }
}

#[test]
fn metashape_has_rigs_spheres_and_cameras_without_a_label() {
    let (folder, all) = written(&FORMS[4]);
    let file = folder.path().join("cameras.xml");
    let good = fs::read_to_string(&file).unwrap();
    let id = |i: usize| format!("<camera id=\"{i}\" sensor_id=\"0\"");
    // The camera 4 is in a rig of 3, by its own transform or by that of a sensor.
    let pose = |c: &Camera| camera_to_world_of(c);
    let own = pose(&all[3]).inverse() * pose(&all[4]);
    let numbers = |m: DMat4| {
        let all = m.transpose().to_cols_array();
        all.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
    };
    let line = good.lines().find(|line| line.contains(&id(4))).unwrap();
    let start = line.find("<transform>").unwrap();
    let end = line.find("</transform>").unwrap();
    let slave = |line: &str| line.replace(&id(4), &format!("{} master_id=\"3\"", id(4)));
    let by_own = format!("{}<transform>{}{}", &line[..start], numbers(own), &line[end..]);
    let by_own = good.replace(line, &slave(&by_own));
    let axes = DMat3::from_mat4(own).transpose().to_cols_array();
    let words = |all: &[f64]| all.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let place = format!(
        "<rotation>{}</rotation><translation>{}</translation></sensor>",
        words(&axes),
        words(&own.w_axis.truncate().to_array())
    );
    let first = good.find("<sensor id=\"0\"").unwrap();
    let last = good.find("</sensor>").unwrap() + "</sensor>".len();
    let sensor = good[first..last].replace("id=\"0\"", "id=\"1\" master_id=\"0\"");
    let sensor = good[first..last].to_owned() + &sensor.replace("</sensor>", &place);
    let by_sensor = format!("{}{}", &line[..start], &line[end + "</transform>".len()..]);
    let by_sensor = slave(&by_sensor).replace("sensor_id=\"0\"", "sensor_id=\"1\"");
    let by_sensor = good.replace(line, &by_sensor).replace(&good[first..last], &sensor);
    for text in [by_own, by_sensor] {
        fs::write(&file, text).unwrap();
        read(&FORMS[4], "rig", folder.path(), &all, &[]);
    }
    let rest: Vec<Camera> = all[..4].iter().chain(&all[5..]).copied().collect();
    fs::write(&file, good.replace("label=\"004\"", "label=\"\"")).unwrap();
    read(&FORMS[4], "label", folder.path(), &rest, &["without a label, so without a photograph"]);
    let sphere = good[first..last].replace("\"0\"", "\"1\"").replace("\"frame\"", "\"spherical\"");
    let text = good.replace(&good[first..last], &(good[first..last].to_owned() + &sphere));
    fs::write(&file, text.replace(&id(4), "<camera id=\"4\" sensor_id=\"1\"")).unwrap();
    read(
        &FORMS[4],
        "sphere",
        folder.path(),
        &rest,
        &["spherical or cylindrical sensors, which are no pinholes"],
    );
    fs::write(&file, good.replace("\"frame\"", "\"spherical\"")).unwrap();
    refused(
        folder.path(),
        &["cameras", "spherical or cylindrical sensors", "9", "frame or fisheye"],
    );
}

/// The camera-to-world matrix with axes x right, y down, z forward.
fn camera_to_world_of(c: &Camera) -> DMat4 {
    let axes = [c.right, -c.up, c.forward, c.eye];
    let [x, y, z, eye] = axes;
    DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), eye.extend(1.0))
}

#[test]
fn images_and_masks_of_another_size_are_brought_to_one() {
    for form in &FORMS {
        for size in [[WIDTH / 2, HEIGHT / 2], [WIDTH * 2, HEIGHT * 2]] {
            let (folder, all) = written(form);
            let at = |i: usize| folder.path().join(form.images).join(format!("{i:03}.png"));
            for (i, camera) in all.iter().enumerate() {
                let mask = folder.path().join(format!("masks/{i:03}.png"));
                write_mask(&mask, &resized(camera, size), false);
            }
            let words = ["masks of another size", "brought to their size: 9"];
            let found = read(form, "masks", folder.path(), &all, &words);
            assert_is_of_ball(&found.train[3], &all[3], form.name);
            if !form.states_size {
                continue;
            }
            for (i, camera) in all.iter().enumerate() {
                write_image(&at(i), &photograph(&resized(camera, size))).unwrap();
            }
            let small: Vec<Camera> = all.iter().map(|camera| resized(camera, size)).collect();
            read(
                form,
                "images",
                folder.path(),
                &small,
                &["the intrinsics are scaled from 48 x 40"],
            );
        }
        let (folder, all) = written(form);
        write_mask(&folder.path().join("masks/000.png"), &resized(&all[0], [40, 40]), false);
        refused(folder.path(), &["masks/000.png", "size", "its aspect ratio"]);
        fs::remove_dir_all(folder.path().join("masks")).unwrap();
        if form.states_size {
            let path = folder.path().join(form.images).join("002.png");
            write_image(&path, &photograph(&resized(&all[2], [40, 40]))).unwrap();
            refused(folder.path(), &["002.png", "size", "40 x 40", "uncropped"]);
        }
    }
}

#[test]
fn a_colour_profile_that_cannot_be_applied_is_named() {
    let (folder, all) = written(&FORMS[0]);
    let path = folder.path().join("images/004.png");
    let image = image::open(&path).unwrap().to_rgb8();
    let file = fs::File::create(&path).unwrap();
    let mut encoder = image::codecs::png::PngEncoder::new(file);
    image::ImageEncoder::set_icc_profile(&mut encoder, b"no profile".to_vec()).unwrap();
    image.write_with_encoder(encoder).unwrap();
    let words = ["1 image has a colour profile that cannot be applied", "images/004.png"];
    read(&FORMS[0], "profile", folder.path(), &all, &words);
}

#[test]
fn a_missing_mask_of_the_camera_file_is_named_and_an_empty_name_is_none() {
    let (folder, all) = written(&FORMS[0]);
    let file = folder.path().join("transforms.json");
    let mut root: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    root["frames"][1]["mask_path"] = json!("");
    root["frames"][2]["mask_path"] = json!("masks/gone.png");
    write_json(&file, &root);
    let words = ["1 mask is named by the camera file and missing: masks/gone.png"];
    read(&FORMS[0], "mask_path", folder.path(), &all, &words);
}

#[test]
fn a_photograph_is_never_its_own_mask_and_other_sets_beside_have_none() {
    let (folder, all) = written(&FORMS[0]);
    let file = folder.path().join("transforms.json");
    let good: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    for name in ["masks/#.png", "/gone/masks/#.png", "mm/#.png", "#.png"] {
        let mut root = good.clone();
        for i in 0..all.len() {
            let own = name.replace('#', &format!("{i:03}"));
            root["frames"][i]["mask_path"] = json!(own);
        }
        write_json(&file, &root);
        let words = ["9 masks are named by the camera file and missing"];
        let found = read(&FORMS[0], name, folder.path(), &all, &words);
        assert!(found.train.iter().all(|view| view.mask.is_none()), "{name}");
    }
    // The names of the photographs make a detour, and another set is beside this one.
    let own = folder.path().join("own");
    (FORMS[0].write)(&own, &all);
    let mut root = good;
    for i in 0..all.len() {
        root["frames"][i]["file_path"] = json!(format!("../own/images/{i:03}.png"));
        write_mask(&folder.path().join(format!("car_masks/{i:03}.png")), &all[i], false);
    }
    write_json(&own.join("transforms.json"), &root);
    let found = load(&own, &LoadOptions::default()).unwrap();
    assert!(found.train.iter().all(|view| view.mask.is_none()));
}

#[test]
fn files_beside_cameras_and_turned_images_are_told() {
    let (folder, all) = written(&FORMS[3]);
    for name in ["cams/._000_cam.txt", "cams/notes.txt", "cams/pair.txt"] {
        fs::write(folder.path().join(name), "no camera").unwrap();
    }
    read(&FORMS[3], "other files", folder.path(), &all, &[]);
    let (folder, _) = written(&FORMS[0]);
    let file = folder.path().join("transforms.json");
    edit(&file, |text| {
        let mut root: Value = serde_json::from_str(&text).unwrap();
        (root["w"], root["h"]) = (json!(HEIGHT), json!(WIDTH));
        root.to_string()
    });
    refused(folder.path(), &["size", "exchange width and height in the camera file"]);
}

/// The NeRF file of a set, and the frames of another form.
fn other_form(frame: impl Fn(usize, &Camera) -> Value) -> (tempfile::TempDir, Vec<Camera>, Value) {
    let (folder, all) = written(&FORMS[0]);
    fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let frames = all.iter().enumerate().map(|(i, c)| frame(i, c)).collect();
    (folder, all, Value::Array(frames))
}

#[test]
fn sdfstudio_neus2_and_gaussian_splatting_are_read() {
    let k = |c: &Camera| {
        let (f, p) = (c.focal, c.principal);
        json!([[f.x, 0, p.x, 0], [0, f.y, p.y, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    };
    let (folder, all, frames) = other_form(|i, c| {
        let pose = rows(camera_to_world_of(c));
        json!({"rgb_path": format!("images/{i:03}.png"), "camtoworld": pose, "intrinsics": k(c)})
    });
    let mut root = json!({"camera_model": "OPENCV", "width": WIDTH, "height": HEIGHT,
        "scene_box": {"aabb": [[-1, -2, -1], [1, 0, 1]], "radius": 1.5}, "frames": frames});
    let file = folder.path().join("meta_data.json");
    write_json(&file, &root);
    for path in [folder.path(), &file] {
        let found = read(&FORMS[0], "SDFStudio", path, &all, &[]);
        let sphere = Sphere { center: DVec3::new(0.0, -1.0, 0.0), radius: 1.5 };
        assert_eq!(found.bounds, Some(sphere));
    }
    // Without a pose, in the first frame too.
    root["frames"][0]["camtoworld"] = Value::Null;
    write_json(&file, &root);
    read(&FORMS[0], "SDFStudio, null", folder.path(), &all[1..], &["1 image has no usable pose"]);
    root["frames"][2]["camtoworld"] = json!([[1, 0, 0], [0, 1, 0]]);
    write_json(&file, &root);
    refused(folder.path(), &["meta_data.json", "frames/2/camtoworld"]);

    let (folder, all, frames) = other_form(|i, c| {
        let pose = rows(camera_to_world_of(c));
        json!({"file_path": format!("images/{i:03}.png"), "transform_matrix": pose,
            "intrinsic_matrix": k(c)})
    });
    let root = json!({"from_na": true, "w": WIDTH, "h": HEIGHT, "sphere_center": [0, 1, 2],
        "sphere_radius": 0.5, "frames": frames});
    write_json(&folder.path().join("transforms.json"), &root);
    let found = read(&FORMS[0], "NeuS2", folder.path(), &all, &[]);
    assert_eq!(found.bounds, Some(Sphere { center: DVec3::new(0.0, 1.0, 2.0), radius: 0.5 }));

    let (folder, all, mut cameras) = other_form(|i, c| {
        let axes = DMat3::from_mat4(camera_to_world_of(c)).transpose().to_cols_array_2d();
        json!({"id": i, "img_name": format!("{i:03}"), "width": c.width, "height": c.height,
            "position": c.eye.to_array(), "rotation": axes, "fx": c.focal.x, "fy": c.focal.y})
    });
    write_json(&folder.path().join("cameras.json"), &cameras);
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
        property float z\nend_header\n0 0 1\n0 2 0\n";
    fs::write(folder.path().join("input.ply"), ply).unwrap();
    let found = read(&FORMS[0], "splats", folder.path(), &all, &[]);
    assert_eq!(found.points.len(), 2);
    cameras[0]["rotation"] = Value::Null;
    write_json(&folder.path().join("cameras.json"), &cameras);
    read(&FORMS[0], "splats, null", folder.path(), &all[1..], &["1 image has no usable pose"]);

    // COLMAP's points in a .ply file alone.
    let (folder, all) = written(&FORMS[1]);
    fs::remove_file(folder.path().join("sparse/0/points3D.txt")).unwrap();
    fs::write(folder.path().join("sparse/0/points3D.ply"), ply).unwrap();
    let found = read(&FORMS[1], "ply", folder.path(), &all, &[]);
    assert_eq!((found.points.len(), found.is_sure.len()), (2, 0));
}
