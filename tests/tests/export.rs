//! The files that `dsdf mesh` writes, read again by `dsdf eval`.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use tests::input::{Folder, refused};
use tests::{binary, dsdf_json, dsdf_ok};

/// A short fit of a ball, in a folder with the data set.
fn run() -> Folder {
    let folder = Folder::new();
    let mut scene = tests::input::scene();
    scene["sdf"] = json!({"type": "sphere", "center": [0.1, 0.0, 0.0], "radius": 0.7});
    let scene = folder.write("scene.json", &scene);
    let (data, run) = (folder.path("data"), folder.path("run"));
    dsdf_ok(&["synth", &scene, "-o", &data, "--views", "6", "--size", "24x24", "--spp", "4"]);
    let network = ["--width", "16", "--layers", "2"];
    let budget = ["--iterations", "60", "--batch", "128", "--seed", "1"];
    let fit = ["fit", &data, "-o", &run, "--bounds", "0.1,0,0,1"];
    dsdf_ok(&[&fit[..], &network, &budget].concat());
    folder
}

/// `dsdf mesh` with options: its report.
fn mesh(folder: &Folder, file: &str, options: &[&str]) -> Value {
    let (run, output) = (folder.path("run"), folder.path(file));
    let arguments = ["mesh", &run, "-o", &output, "--resolution", "32"];
    dsdf_json(&[&arguments[..], options].concat())
}

#[test]
fn every_file_is_the_surface_of_the_run_in_colour_and_upright() {
    let folder = run();
    let run = folder.path("run");
    for (file, options) in [
        ("m.ply", &[][..]),
        ("m.obj", &["--color", "none"]),
        ("m.glb", &["--scale", "1000"]),
        ("turned.glb", &["--up", "-x"]),
        ("m.stl", &["--decimate", "1000"]),
        ("painted.glb", &["--texture", "128"]),
        ("painted.obj", &["--texture", "100", "--decimate", "2000"]),
    ] {
        let report = mesh(&folder, file, options);
        assert_eq!((&report["closed"], &report["genus"]), (&json!(true), &json!(0)), "{file}");
        let is_colored = file != "m.stl" && !options.contains(&"none");
        assert_eq!(report["color_cameras"], if is_colored { json!(6) } else { Value::Null });
        assert!(!is_colored || report["unseen"].as_f64().unwrap() < 0.3, "{report}");
        // The cameras of `synth` stand around the z axis.
        let up = match file {
            "m.glb" | "painted.glb" => json!([0.0, 0.0, 1.0]),
            "turned.glb" => json!([-1.0, 0.0, 0.0]),
            _ => Value::Null,
        };
        assert_eq!(report["up"], up, "{file}");
        let width = match options {
            ["--texture", width, ..] => width.parse().unwrap(),
            _ => 0,
        };
        assert_eq!(report["texture"]["size"][0].as_u64().unwrap_or(0), width, "{file}");
        let truth = folder.path(file);
        let eval = dsdf_json(&["eval", &run, "--mesh", &truth, "--resolution", "32"]);
        let chamfer = eval["chamfer"].as_f64().unwrap();
        assert!(chamfer < 5e-3, "{file}: {chamfer} from the surface it was extracted from");
    }
    let image = film::image_size(Path::new(&folder.path("painted_texture.png"))).unwrap();
    assert!(image.0 == 100 && image.1 <= 100 && Path::new(&folder.path("painted.mtl")).exists());
    let glb = folder.path("both.glb");
    let both = ["mesh", &run, "-o", &glb, "--texture", "256", "--color", "none"];
    refused(&both, 2, &["--texture", "--color none"]);
    assert!(mesh(&folder, "m.stl", &["--decimate", "1000"])["faces"].as_u64().unwrap() <= 1000);
    for (options, word) in [
        (&["--up", "z"][..], "--up"),
        (&["--scale", "0"], "--scale"),
        (&["--scale", "inf"], "--scale"),
        (&["--scale", "1e39"], "--scale"),
        (&["--decimate", "3"], "--decimate"),
        (&["--up", "w"], "--up"),
        (&["--texture", "256"], "--texture"),
        (&["--texture", "9000"], "--texture"),
    ] {
        let ply = folder.path("none.ply");
        refused(&[&["mesh", &run, "-o", &ply], options].concat(), 2, &[word]);
        assert!(!Path::new(&ply).exists());
    }
}

#[test]
fn a_run_whose_data_set_is_gone_has_a_mesh_without_colours_and_a_warning() {
    let folder = run();
    std::fs::remove_dir_all(folder.path("data")).unwrap();
    let output = Command::new(binary())
        .args(["mesh", &folder.path("run"), "--resolution", "24", "--json"])
        .args(["-o", &folder.path("m.glb")])
        .output()
        .unwrap();
    assert!(output.status.success());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.lines().any(|l| l.starts_with("WARNING no colours")), "{errors}");
    let glb = folder.path("painted.glb");
    refused(&["mesh", &folder.path("run"), "-o", &glb, "--texture", "64"], 2, &["data"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["color_cameras"], &report["up"]), (&Value::Null, &json!([0.0, 0.0, 1.0])));
}
