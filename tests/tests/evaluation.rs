//! `dsdf eval`: views with pictures, and DTU's protocol on a cloud of points.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;

use glam::DVec3;
use serde_json::{Value, json};
use tests::input::{Folder, ball, dataset, fit_two_iterations, refused};
use tests::{dsdf, dsdf_json, dsdf_ok};

/// The PSNR of the numbers with 8 bits over the pixels that `used` accepts.
fn psnr(photo: &image::RgbImage, render: &image::RgbImage, used: impl Fn(u32, u32) -> bool) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0);
    for (x, y, p) in photo.enumerate_pixels().filter(|(x, y, _)| used(*x, *y)) {
        for (a, b) in p.0.iter().zip(&render.get_pixel(x, y).0) {
            squares += ((f64::from(*a) - f64::from(*b)) / 255.0).powi(2);
            count += 1.0;
        }
    }
    -10.0 * f64::log10(squares / count)
}

/// The numbers of each view are those of its picture, which is of 8 bits.
#[test]
fn the_errors_of_each_view_follow_from_its_picture() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "9"), folder.path("run"));
    let options = ["--iterations", "60", "--batch", "256"];
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..]].concat());
    let pictures = folder.path("deep/pictures");
    let report = dsdf_json(&["eval", &run, "--pictures", &pictures]);
    let views = report["per_view"].as_array().unwrap();
    assert_eq!((views.len(), &report["views"]), (2, &json!(2)));
    let names: Vec<String> = fs::read_dir(&pictures)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names.len(), 2, "{names:?}");
    for (i, view) in views.iter().enumerate() {
        let start = format!("{i:03}-");
        let name = names.iter().find(|name| name.starts_with(&start)).unwrap();
        let sheet = image::open(format!("{pictures}/{name}")).unwrap().to_rgb8();
        let mask = format!("{data}/masks/{}.png", view["name"].as_str().unwrap());
        let mask = image::open(&mask).unwrap_or_else(|e| panic!("{mask}: {e}")).to_luma8();
        // Pictures may have a gap between them.
        let step = (sheet.width() - 32) / 3;
        assert!(sheet.height() >= 32 && step >= 32);
        // Each part has a label above it.
        let top = sheet.height() - 32;
        let part = |k: u32| image::imageops::crop_imm(&sheet, k * step, top, 32, 32).to_image();
        let (photo, render) = (part(0), part(1));
        let near = |key: &str, expected: f64| {
            let found = view[key].as_f64().unwrap_or_else(|| panic!("no {key} in {view}"));
            assert!((found - expected).abs() < 0.1, "{key}: {found} and {expected}");
        };
        near("psnr", psnr(&photo, &render, |_, _| true));
        near("psnr_masked", psnr(&photo, &render, |x, y| mask.get_pixel(x, y).0[0] >= 128));
        assert!(view["ssim"].is_f64() && view["mask_iou"].is_f64(), "{view}");
    }
    for key in ["psnr", "psnr_masked", "ssim", "mask_iou"] {
        let mean = views.iter().map(|v| v[key].as_f64().unwrap()).sum::<f64>() / 2.0;
        assert!((report[key].as_f64().unwrap() - mean).abs() < 1e-12, "{key}: {report}");
    }
    let text = String::from_utf8(dsdf(&["eval", &run, "--views"]).stdout).unwrap();
    assert!(text.contains("held-out view") && text.contains("PSNR in the masks"), "{text}");
    // Without pictures and tables, the numbers are the same.
    assert_eq!(dsdf_json(&["eval", &run]), report);
}

/// A run of two iterations on nine photographs without a split of their own, of which three are held
/// out: the folder of the data set, its camera file with its content, and the run.
fn run_of_nine(folder: &Folder) -> (String, String, Value, String) {
    let (data, run) = (ball(folder, "9"), folder.path("run"));
    let file = format!("{data}/transforms.json");
    fs::rename(format!("{data}/transforms_train.json"), &file).unwrap();
    fs::remove_file(format!("{data}/transforms_test.json")).unwrap();
    let fit = ["fit", &data, "-o", &run, "--iterations", "2", "--batch", "64", "--held-out"];
    let words = ["held-out views: found 8, expected at most 7"];
    refused(&[&fit[..], &["8"]].concat(), 2, &words);
    refused(&[&fit[..], &["some"]].concat(), 2, &["--held-out", "none or a number"]);
    dsdf_ok(&[&fit[..], &["3"]].concat());
    let cameras = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    (data, file, cameras, run)
}

#[test]
fn views_stay_held_out_when_photographs_come_or_go() {
    let folder = Folder::new();
    let (data, file, cameras, run) = run_of_nine(&folder);
    let before = dsdf_json(&["eval", &run]);
    assert_eq!(before["views"], 3);
    // Another photograph in front: the split by number would be another one.
    let mut more = cameras.clone();
    let frames = more["frames"].as_array_mut().unwrap();
    let mut first = frames[4].clone();
    let image = first["file_path"].as_str().unwrap().to_owned();
    let image = format!("{data}/{image}");
    let image = if fs::exists(&image).unwrap() { image } else { image + ".png" };
    fs::copy(&image, format!("{data}/again.png")).unwrap();
    first["file_path"] = json!("again.png");
    frames.insert(0, first);
    fs::write(&file, more.to_string()).unwrap();
    assert_eq!(dsdf_json(&["eval", &run]), before);
    // A photograph less is refused, by each command that reads it.
    let mut less = cameras.clone();
    less["frames"].as_array_mut().unwrap().remove(4);
    fs::write(&file, less.to_string()).unwrap();
    let words = ["views: found none with the name", "expected the 9 views that the run began with"];
    refused(&["eval", &run], 2, &words);
    refused(&["inspect", &run, "-o", &folder.path("i.png")], 2, &words);
    refused(&["report", &run, "-o", &folder.path("r.html")], 2, &words);
    refused(&["fit", "--resume", "-o", &run, "--iterations", "4"], 2, &words);
    // As another data set, its views have the parts that they had in the run.
    assert_eq!(dsdf_json(&["eval", &run, "--dataset", &data]), before);
    dsdf_ok(&["report", &run, "--dataset", &data, "-o", &folder.path("r.html")]);
    let picture = folder.path("r.png");
    let few = ["--views", "1", "--size", "16", "--spp", "1"];
    dsdf_ok(&[&["render", &run, "--dataset", &data, "-o", &picture], &few[..]].concat());
}

#[test]
fn a_data_set_may_move_and_its_poses_may_not_change() {
    let folder = Folder::new();
    let (data, _, mut cameras, run) = run_of_nine(&folder);
    let moved = folder.path("moved");
    fs::rename(&data, &moved).unwrap();
    refused(&["eval", &run], 2, &["data set: found no such file or folder", "--resume"]);
    dsdf_ok(&["fit", &moved, "--resume", "-o", &run, "--iterations", "4"]);
    assert_eq!(dsdf_json(&["eval", &run])["views"], 3);
    // The same photographs with poses of another scale, as a second reconstruction has them.
    for frame in cameras["frames"].as_array_mut().unwrap() {
        for row in 0..3 {
            let number = &mut frame["transform_matrix"][row][3];
            *number = json!(1.1 * number.as_f64().unwrap());
        }
    }
    fs::write(format!("{moved}/transforms.json"), cameras.to_string()).unwrap();
    let words = ["poses: found others", "the poses that the run was fitted to"];
    refused(&["eval", &run], 2, &words);
    refused(&["fit", "--resume", "-o", &run, "--iterations", "6"], 2, &words);
    dsdf_ok(&["eval", &run, "--dataset", &moved]);
}

#[test]
fn lists_of_views_in_the_run_file_are_checked() {
    let folder = Folder::new();
    let (_, _, _, run) = run_of_nine(&folder);
    let toml = format!("{run}/fit.toml");
    let text = fs::read_to_string(&toml).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with("held_out = ")).collect::<Vec<_>>();
    fs::write(&toml, lines.join("\n")).unwrap();
    refused(&["eval", &run], 2, &["fit.toml: held_out: found missing field"]);
    let empty =
        text.replace("[views]", "[views]\ntrain = []\n#").replace("\ntrain = [\"", "\n# [\"");
    fs::write(&toml, empty).unwrap();
    refused(&["eval", &run], 2, &["fit.toml: train: found an empty list"]);
}

#[test]
fn a_run_without_held_out_views_says_so() {
    let folder = Folder::new();
    let mut frames = dataset(&folder);
    frames["frames"].as_array_mut().unwrap().truncate(2);
    folder.write("transforms.json", &frames);
    let (data, run) = (folder.path(""), folder.path("run"));
    let options = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1"];
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..]].concat());
    let text = String::from_utf8(dsdf(&["eval", &run]).stdout).unwrap();
    assert!(text.starts_with("no held-out view: PSNR, SSIM and mask IoU need one\n"), "{text}");
    let report = dsdf_json(&["eval", &run, "--pictures", &folder.path("pictures")]);
    assert_eq!((&report["per_view"], &report["psnr"]), (&json!([]), &Value::Null));
    assert!(!std::path::Path::new(&folder.path("pictures")).exists());
}

/// A run of two iterations is a ball of between half and 0.6 of the bounding radius. The cloud is a
/// sphere of radius 0.6; the distances follow from the radii of the mesh's vertices.
#[test]
fn accuracy_and_completeness_are_those_of_concentric_spheres() {
    let folder = Folder::new();
    let run = fit_two_iterations(&folder);
    let count = 60_000;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let point = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sin, cos) = (golden * f64::from(i)).sin_cos();
        0.6 * DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
    };
    let points: Vec<DVec3> = (0..count).map(point).collect();
    let properties = "property float x\nproperty float y\nproperty float z\nend_header\n";
    let header =
        |format: &str| format!("ply\nformat {format} 1.0\nelement vertex {count}\n{properties}");
    let (text, binary) = (folder.path("text.ply"), folder.path("binary.ply"));
    let lines: String = points.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
    fs::write(&text, header("ascii") + &lines).unwrap();
    let body = points.iter().flat_map(|p| p.as_vec3().to_array().map(f32::to_le_bytes).concat());
    let bytes: Vec<u8> =
        header("binary_little_endian").into_bytes().into_iter().chain(body).collect();
    fs::write(&binary, bytes).unwrap();

    let mesh = folder.path("mesh.obj");
    dsdf_ok(&["mesh", &run, "-o", &mesh, "--resolution", "64"]);
    let radii: Vec<f64> = fs::read_to_string(&mesh)
        .unwrap()
        .lines()
        .filter_map(|line| line.strip_prefix("v "))
        // The colours follow the coordinates.
        .map(|line| line.split(' ').take(3).map(|n| n.parse::<f64>().unwrap().powi(2)).sum::<f64>())
        .map(f64::sqrt)
        .collect();
    let expected = 0.6 - radii.iter().sum::<f64>() / radii.len() as f64;

    let fixed = ["eval", &run, "--resolution", "64", "--points"];
    let report = dsdf_json(&[&fixed[..], &[&text]].concat());
    for key in ["accuracy", "completeness", "overall", "accuracy_median", "completeness_median"] {
        let found = report[key].as_f64().unwrap_or_else(|| panic!("no {key} in {report}"));
        assert!((found - expected).abs() < 0.003, "{key}: {found} and {expected}");
    }
    let mean =
        0.5 * (report["accuracy"].as_f64().unwrap() + report["completeness"].as_f64().unwrap());
    assert!((report["overall"].as_f64().unwrap() - mean).abs() < 1e-12, "{report}");
    assert_eq!(report["accuracy_beyond_cap"], json!(0.0));
    assert!(report["chamfer"].is_null(), "{report}");
    // Further comparisons with a tenth of the points.
    let spaced = |points: &str, options: &[&str]| {
        dsdf_json(&[&fixed[..], &[points, "--point-spacing", "0.004"], options].concat())
    };
    let other = spaced(&binary, &["--threads", "1"])["overall"].as_f64().unwrap();
    let overall = spaced(&text, &[])["overall"].as_f64().unwrap();
    assert!((other - overall).abs() < 1e-6, "{other} and {overall}");
    assert!((overall - mean).abs() < 0.003, "{overall} and {mean}");
    // No two points are within a cap of 1e-6. Half of the reconstruction is left by a cut of the
    // unseen part, so half of the reference has no part of it near.
    let far = spaced(&text, &["--point-cap", "1e-6"]);
    assert!(far["overall"].is_null() && far["accuracy_beyond_cap"] == json!(1.0), "{far}");
    let options = ["--point-cap", "0.2", "--point-spacing", "0.01", "--cull", "seen"];
    let cut = dsdf_json(&[&fixed[..], &[&text], &options].concat());
    assert!(cut["completeness_beyond_cap"].as_f64().unwrap() > 0.3, "{cut}");
    assert_eq!((&cut["accuracy_beyond_cap"], &cut["cut"][0]["by"]), (&json!(0.0), &json!("seen")));
    refuse_wrong_points(&folder, &run, [&mesh, &text], &header("ascii").replace("60000", "0"));
}

/// The points of the data set are a sphere of radius 0.6, and some outside of the bounding sphere.
#[test]
fn points_of_the_data_set_have_distances_to_the_surface() {
    let folder = Folder::new();
    let run = fit_two_iterations(&folder);
    let eval = ["eval", &run, "--resolution", "64", "--points", "auto"];
    refused(&eval, 2, &["points: found 0 points", "COLMAP"]);

    let point = |i: u32| {
        let radius = if i < 2000 { 0.6 } else { 5.0 };
        let z = 1.0 - (f64::from(i % 2000) + 0.5) / 1000.0;
        let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
        radius * DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
    };
    let lines: String =
        (0..3000).map(point).map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
    let header = "ply\nformat ascii 1.0\nelement vertex 3000\nproperty float x\n\
                  property float y\nproperty float z\nend_header\n";
    fs::write(folder.path("points.ply"), header.to_owned() + &lines).unwrap();
    let file = folder.path("transforms.json");
    let mut cameras: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    cameras["ply_file_path"] = json!("points.ply");
    fs::write(&file, cameras.to_string()).unwrap();

    let report = dsdf_json(&eval);
    assert_eq!(report["points"], json!(2000), "{report}");
    // By another route: vertices of the mesh have the radius of the surface.
    let mesh = folder.path("mesh.obj");
    dsdf_ok(&["mesh", &run, "-o", &mesh, "--resolution", "64"]);
    let radius_of = |line: &str| {
        let square = |n: &str| n.parse::<f64>().unwrap().powi(2);
        line.strip_prefix("v ").map(|n| n.split(' ').take(3).map(square).sum::<f64>().sqrt())
    };
    let text = fs::read_to_string(&mesh).unwrap();
    let radii: Vec<f64> = text.lines().filter_map(radius_of).collect();
    // The bounding radius is 1.
    let expected = 0.6 - radii.iter().sum::<f64>() / radii.len() as f64;
    for key in ["points_median", "points_mean"] {
        let found = report[key].as_f64().unwrap_or_else(|| panic!("no {key} in {report}"));
        assert!((found - expected).abs() < 0.003, "{key}: {found} and {expected}");
    }
    let text = String::from_utf8(dsdf(&eval).stdout).unwrap();
    assert!(text.contains("points of the data set, median"), "{text}");
    refused(&[&eval[..], &["--point-cap", "1"]].concat(), 2, &["--points", "auto", "--point-cap"]);
}

/// Refusals of `eval --points` for a run with a mesh and a cloud; `empty` is a cloud of no points.
fn refuse_wrong_points(folder: &Folder, run: &str, [mesh, text]: [&str; 2], empty: &str) {
    let refuse = |options: &[&str], words: &[&str]| {
        refused(&[&["eval", run][..], options].concat(), 2, words);
    };
    let path = folder.path("empty.ply");
    fs::write(&path, empty).unwrap();
    refuse(&["--points", &path], &["empty.ply", "no points", "one or more"]);
    refuse(&["--points", mesh], &["mesh.obj", ".ply"]);
    let point = folder.path("point.obj");
    fs::write(&point, "v 0 0 0\nf 1 1 1\n").unwrap();
    refuse(&["--mesh", &point], &["point.obj: faces: found only faces without area, expected"]);
    refuse(&["--points", text, "--point-spacing", "0"], &["--point-spacing", "1e-12"]);
    refuse(&["--points", text, "--point-spacing", "1e-9"], &["--point-spacing", "memory"]);
    refuse(&["--point-cap", "1"], &["--points"]);
    refuse(&["--cull", "seen"], &["--cull", "--mesh or --points"]);
    refuse(&["--points", text, "--cull", "masks"], &["masks: found no view with a mask"]);
}
