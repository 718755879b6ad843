//! A data set far from the world's origin: the run, its mesh and its model are as good as those of
//! the same data set near the origin, and in world units.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use serde_json::{Value, json};
use tests::input::Folder;
use tests::{dsdf_json, dsdf_ok};

/// The result of a short fit of a ball at `center`: the report of `eval` with the true mesh, and
/// the model file as text.
fn fit(center: [f64; 3]) -> (Value, String) {
    let folder = Folder::new();
    let mut scene = tests::input::scene();
    scene["sdf"] = json!({"type": "sphere", "center": center, "radius": 0.7});
    let scene = folder.write("scene.json", &scene);
    let (data, run) = (folder.path("data"), folder.path("run"));
    dsdf_ok(&["synth", &scene, "-o", &data, "--views", "6", "--size", "24x24", "--spp", "4"]);
    let [x, y, z] = center;
    let bounds = format!("{x},{y},{z},1");
    let network = ["--width", "16", "--layers", "2"];
    let budget = ["--iterations", "60", "--batch", "128", "--seed", "1"];
    let fit = ["fit", &data, "-o", &run, "--bounds", &bounds];
    dsdf_ok(&[&fit[..], &network, &budget].concat());
    // Resuming and rendering read the run again.
    dsdf_ok(&["fit", &data, "-o", &run, "--resume", "--iterations", "80"]);
    dsdf_ok(&["render", &run, "-o", &folder.path("views.png"), "--views", "2", "--size", "16"]);
    dsdf_ok(&["mesh", &run, "-o", &folder.path("mesh.ply"), "--resolution", "32"]);
    let truth = folder.path("data/truth.ply");
    let report = dsdf_json(&["eval", &run, "--mesh", &truth, "--resolution", "64"]);
    let model = std::fs::read(folder.path("run/model.safetensors")).unwrap();
    (report, String::from_utf8_lossy(&model).into_owned())
}

#[test]
fn a_distant_data_set_is_fitted_as_well_as_a_near_one() {
    let far = [1e6, 2e6, -3e6];
    let [(near, _), (report, model)] = [[0.0; 3], far].map(fit);
    assert!(model.contains("[1000000, 2000000, -3000000]"), "{}", &model[..400]);
    for name in ["psnr", "chamfer"] {
        let [near, far] = [&near, &report].map(|r| r[name].as_f64().unwrap());
        assert!((far - near).abs() < 0.02 * near, "{name}: {far} far, {near} near");
    }
}
