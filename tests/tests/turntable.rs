//! An object turned in front of a fixed camera, from photographs to the evaluation of a run.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;

use serde_json::json;
use tests::compose::{Kind, compose};
use tests::input::{Folder, refused};
use tests::{dsdf_json, dsdf_ok};

/// Photographs of two balls, which turn in front of a backdrop that stands still in the image, and
/// the mesh of the balls.
fn photographs(folder: &Folder) -> String {
    let ball =
        |x: f64, radius: f64| json!({"type": "sphere", "center": [x, 0, 0], "radius": radius});
    let file = json!({
        "camera": {"width": 8, "height": 8, "focal": 8, "principal": [4, 4],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "union", "children": [ball(-0.25, 0.4), ball(0.35, 0.25)]},
        "appearance": {"type": "lambert", "albedo": [0.7, 0.6, 0.5], "ambient": [0.4, 0.4, 0.4],
                       "lights": [{"type": "directional", "direction": [0.4, 0.5, 1],
                                   "radiance": [0.6, 0.6, 0.6]}]},
        "background": [0, 0, 0]
    });
    let scene = scene::SceneFile::from_value("balls.json".as_ref(), &file).unwrap();
    let options = scene::synth::Options { views: 24, size: [64, 48], spp: 8, seed: 0 };
    let renders = folder.path("renders");
    let written = renders.as_ref();
    scene::synth::synthesise(&scene, "balls.json".as_ref(), written, &options, &|_| {}).unwrap();
    let data = folder.path("data");
    compose(Kind::TurntableNoise, written, data.as_ref(), 1, &mut |_| {}).unwrap();
    fs::remove_dir_all(format!("{data}/masks")).unwrap();
    data
}

#[test]
fn a_fit_of_a_turned_object_finds_its_shape_and_keeps_its_picture() {
    let folder = Folder::new();
    let data = photographs(&folder);
    let picture = folder.path("inspect.png");
    let found = dsdf_json(&["inspect", &data, "-o", &picture]);
    assert_eq!(found["background_kind"], "picture");
    assert!(found["backdrop_still"].as_f64().unwrap() > 0.9, "{found}");

    let (run, parts) = (folder.path("run"), folder.path("parts"));
    let options = ["--iterations", "300", "--seed", "1", "--preview-every", "150"];
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..]].concat());
    dsdf_ok(&[&["fit", &data, "-o", &parts, "--stop-after", "100"], &options[..]].concat());
    dsdf_ok(&["fit", "--resume", "-o", &parts]);
    for file in ["model", "radiance", "background"] {
        let bytes = |run: &str| fs::read(format!("{run}/{file}.safetensors")).unwrap();
        assert!(bytes(&run) == bytes(&parts), "{file}: other bits after a resumption");
    }

    let truth = format!("{data}/truth.ply");
    let eval = dsdf_json(&["eval", &run, "--mesh", &truth]);
    let of = |key: &str| eval[key].as_f64().unwrap();
    println!("{} {}", of("chamfer_relative"), of("psnr"));
    assert!(of("chamfer_relative") < 0.04, "{eval}");
    // A volume shows the backdrop badly: 17 dB.
    assert!(of("psnr") > 24.0, "{eval}");
    dsdf_ok(&["report", &run, "-o", &folder.path("report.html")]);
    dsdf_ok(&["render", &run, "-o", &folder.path("turn.png"), "--size", "16"]);

    fs::copy(format!("{run}/model.safetensors"), format!("{run}/background.safetensors")).unwrap();
    let mesh = ["mesh", &run, "-o", &folder.path("m.ply")];
    refused(&mesh, 2, &["background.safetensors", "dsdf.background"]);
}
