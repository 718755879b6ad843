//! Wrong input: one line that names the place, exit status 2, no unfinished file, no panic.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tests::dsdf;
use tests::input::{Folder, dataset, fit_two_iterations, refused, scene};

#[test]
fn wrong_scenes_are_refused_with_the_place_of_the_error() {
    let folder = Folder::new();
    let out = folder.path("out.npy");
    let mut cases: Vec<(Value, &str)> = Vec::new();
    let mut change = |pointer: &str, value: Value, word: &'static str| {
        let mut s = scene();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        s.pointer_mut(parent).unwrap()[key] = value;
        cases.push((s, word));
    };
    change("/sdf/radios", json!(1), "/sdf/radios");
    change("/appearance/radiance", json!([1e38, 1, 1]), "none beyond 1e30");
    change("/background", json!([0, -1e300, 0]), "none beyond 1e30");
    change("/sdf/radius", json!("big"), "/sdf/radius");
    change("/sdf/radius", json!(-1), "/sdf/radius");
    change("/sdf/type", json!("ball"), "/sdf/type");
    change("/camera/focal", json!(0), "/camera/focal");
    change("/camera/width", json!(0), "/camera/width");
    change("/camera/target", json!([0, 0, 4]), "/camera/target");
    change("/appearance/type", json!("glass"), "/appearance/type");
    change("/background", json!([0, 0]), "/background");
    change("/sdf", json!({"type": "neural", "weights": "none.safetensors"}), "none.safetensors");
    for (value, word) in cases {
        let path = folder.write("scene.json", &value);
        refused(&["render", &path, "-o", &out], 2, &["found", "expected", word]);
    }
    fs::write(folder.path("scene.json"), "{\"camera\": ").unwrap();
    refused(&["render", &folder.path("scene.json"), "-o", &out], 2, &["line 1"]);
    refused(&["render", &folder.path("none.json"), "-o", &out], 2, &["none.json"]);
    assert!(!Path::new(&out).exists());
}

#[test]
fn outputs_that_cannot_be_written_are_named() {
    let folder = Folder::new();
    let path = folder.write("scene.json", &scene());
    refused(&["render", &path, "-o", &folder.path("out.gif")], 2, &["out.gif", ".png"]);
    refused(&["render", &path, "-o", &folder.path("no/out.png")], 2, &["no"]);
    assert_eq!(folder.files(), 1);
    // /dev/full takes no bytes, like a full disk.
    if Path::new("/dev/full").exists() {
        std::os::unix::fs::symlink("/dev/full", folder.path("full.png")).unwrap();
        let output = dsdf(&["render", &path, "-o", &folder.path("full.png")]);
        assert!(
            output.status.success(),
            "a rename replaces the link and needs no room on the device"
        );
    }
}

#[test]
fn full_disk_gives_exit_status_1_and_leaves_no_file() {
    // A limit of the file size fails a write as a full disk does.
    let folder = Folder::new();
    let mut big = scene();
    (big["camera"]["width"], big["camera"]["height"]) = (json!(256), json!(256));
    let path = folder.write("scene.json", &big);
    let command = format!(
        "trap '' XFSZ; ulimit -f 8; exec '{}' render '{path}' -o '{}' --spp 1 --quiet",
        tests::binary().display(),
        folder.path("out.npy")
    );
    let output = std::process::Command::new("sh").args(["-c", &command]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert_eq!(folder.files(), 1, "only the scene is left");
}

#[test]
fn wrong_options_of_gradient_are_refused() {
    let folder = Folder::new();
    let (path, out) = (folder.write("scene.json", &scene()), folder.path("g.npy"));
    let by_radius = ["gradient", &path, "--wrt", "/sdf/radius", "-o", &out];
    let gradient = |flags: &[&str], words: &[&str]| {
        refused(&[&by_radius[..], flags].concat(), 2, words);
    };
    gradient(&["--top-k", "1"], &["--top-k"]);
    gradient(&["--gamma", "nan"], &["gamma"]);
    gradient(&["--estimator", "magic"], &["magic", "paper"]);
    gradient(&["--filter", "tent"], &["--filter", "tent", "box or gaussian"]);
    gradient(
        &["--filter", "gaussian", "--estimator", "refined"],
        &["--filter", "gaussian", "box", "refined"],
    );
    gradient(&["--filter", "box", "--estimator", "was"], &["--filter", "box", "gaussian", "was"]);
    gradient(
        &["--estimator", "paper", "--top-k", "1"],
        &["--top-k", "1", "one point alone keeps none"],
    );
    gradient(&["--gamma", "-2"], &["--gamma", "found -2", "above 0"]);
    gradient(&["--seed", "-1"], &["--seed", "-1"]);
    gradient(&["--threads", "-1"], &["--threads", "-1"]);
    gradient(&["--steps", "0"], &["--steps"]);
    refused(&["gradient", &path, "--wrt", "/sdf/height", "-o", &out], 2, &["/sdf/height"]);
    refused(
        &["gradient", &path, "--target", &path, "-o", "g.safetensors", "--estimator", "fd"],
        2,
        &["--estimator", "fd"],
    );
    let png = folder.path("g.png");
    refused(&["gradient", &path, "--wrt", "/sdf/radius", "-o", &png], 2, &[".npy"]);
    refused(&["gradient", &path, "-o", &out], 2, &["--wrt"]);
}

#[test]
fn wrong_data_sets_are_refused() {
    let folder = Folder::new();
    let good = dataset(&folder);
    let run = folder.path("run");
    let data = folder.path("");
    let check = |value: &Value, words: &[&str]| {
        folder.write("transforms.json", value);
        refused(&["fit", &data, "-o", &run, "--iterations", "1"], 2, words);
        assert!(!PathBuf::from(&run).exists(), "a refused fit leaves no folder");
    };
    let mut bad = good.clone();
    bad["frames"][1]["transform_matrix"][0][3] = json!("far");
    check(&bad, &["frames/1/transform_matrix"]);
    bad["frames"][1]["transform_matrix"] =
        json!([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]);
    check(&bad, &["frames/1/transform_matrix", "rotation"]);
    let mut bad = good.clone();
    bad["frames"][1]["transform_matrix"][0][3] = json!(1e300);
    check(&bad, &["frames/1/transform_matrix", "a camera with the coordinate 1e300"]);
    let mut bad = good.clone();
    bad["frames"] = json!([]);
    check(&bad, &["frames"]);
    let mut bad = good.clone();
    // One of three images may be missing.
    bad["frames"][1]["file_path"] = json!("none");
    bad["frames"][2]["file_path"] = json!("none");
    check(&bad, &["2 of 3 missing", "none"]);
    let mut bad = good.clone();
    bad["w"] = json!(9);
    check(&bad, &["size", "8 x 8", "9 x 8"]);
    let mut bad = good.clone();
    bad["camera_angle_x"] = json!(0);
    check(&bad, &["camera_angle_x"]);
    let image = fs::read(folder.path("0.png")).unwrap();
    fs::write(folder.path("0.png"), &image[..image.len() / 2]).unwrap();
    check(&good, &["0.png"]);
    fs::write(folder.path("0.png"), &image).unwrap();
    folder.write("transforms.json", &good);
    refused(
        &["fit", &data, "-o", &run, "--iterations", "1", "--bounds", "0,0,3,2"],
        2,
        &["camera", "--bounds"],
    );
    refused(&["fit", &data, "-o", &run, "--bounds", "0,50,0,0.5"], 2, &["bounds", "no pixel"]);
    assert!(!PathBuf::from(&run).exists(), "a refused fit leaves no folder");
    refused(&["fit", &data, "-o", &run, "--top-k", "1"], 2, &["arguments: --top-k"]);
    refused(&["fit", &data, "-o", &run, "--width", "100000"], 2, &["width"]);
    refused(&["fit", &folder.path("nothing"), "-o", &run], 2, &["nothing"]);
    let empty = tempfile::tempdir().unwrap();
    refused(&["fit", &empty.path().to_string_lossy(), "-o", &run], 2, &["no camera file"]);
    refused(&["fit", &data, "-o", &folder.path("0.png"), "--iterations", "1"], 2, &["0.png"]);
}

#[test]
fn wrong_middlebury_cameras_are_refused() {
    let folder = Folder::new();
    dataset(&folder);
    let cameras = |k: &str| {
        let line = |i: i32| format!("{i}.png {k} 1 0 0 0 1 0 0 0 1 0 0 4\n");
        format!("3\n{}{}{}", line(0), line(1), line(2))
    };
    for (k, word) in [
        ("0 0 4 0 16 4 0 0 1", "singular K"),
        ("nan 0 4 0 16 4 0 0 1", "line 2"),
        ("16 0 4 0 16 4 0 0", "line 2"),
    ] {
        fs::write(folder.path("x_par.txt"), cameras(k)).unwrap();
        refused(
            &["inspect", &folder.path(""), "-o", &folder.path("i.png")],
            2,
            &["x_par.txt", word],
        );
    }
    assert!(!Path::new(&folder.path("i.png")).exists());
}

#[test]
fn folders_without_a_run_and_broken_models_are_refused() {
    let folder = Folder::new();
    refused(&["mesh", &folder.path(""), "-o", &folder.path("m.ply")], 2, &["fit.toml"]);
    refused(&["eval", &folder.path("")], 2, &["fit.toml"]);
    let model = folder.path("m.safetensors");
    fs::write(&model, b"junk").unwrap();
    let (points, out) = (folder.path("p.npy"), folder.path("o.npy"));
    refused(&["query", &model, &points, "-o", &out], 2, &["m.safetensors"]);
    refused(&["nonsense"], 2, &["nonsense"]);
}

#[test]
fn wrong_options_and_checkpoints_of_a_resumed_fit_are_refused() {
    let folder = Folder::new();
    let run = fit_two_iterations(&folder);
    let resume = ["fit", "--resume", "-o", &run];
    let resume_refused = |flags: &[&str], words: &[&str]| {
        refused(&[&resume[..], flags].concat(), 2, words);
    };
    resume_refused(&["--batch", "32"], &["fit.toml", "batch", "32", "16"]);
    // Equal to its default, and not to its value in the run.
    resume_refused(&["--batch", "1024"], &["fit.toml", "batch", "1024", "16"]);
    resume_refused(&["--preset", "fast"], &["--preset", "--resume"]);
    tests::dsdf_ok(&[&resume[..], &["--batch", "16", "--iterations", "3"]].concat());
    resume_refused(&["--iterations", "1"], &["arguments: --iterations", "at least the 3"]);
    resume_refused(
        &["--time", "1ms"],
        &["arguments: --time: found 0.001 s, expected at least the"],
    );
    resume_refused(&["--time", "nan"], &["--time", "nan", "expected a time above 0"]);
    // A checkpoint with a number that is none, and one that is cut short.
    let state = folder.path("run/checkpoint/state.safetensors");
    let mut bytes = fs::read(&state).unwrap();
    let end = bytes.len() - 4;
    bytes[end..].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&state, bytes).unwrap();
    resume_refused(&["--iterations", "4"], &["state.safetensors", "NaN"]);
    let options = fs::read_to_string(folder.path("run/fit.toml")).unwrap();
    assert!(options.contains("iterations = 3"), "a refused fit keeps its options: {options}");
    fs::write(&state, b"junk").unwrap();
    resume_refused(&["--iterations", "4"], &["state.safetensors", "whole checkpoint"]);
}

#[test]
fn wrong_entries_of_a_runs_fit_toml_are_refused_by_name() {
    let folder = Folder::new();
    let run = fit_two_iterations(&folder);
    let path = folder.path("run/fit.toml");
    let right = fs::read_to_string(&path).unwrap();
    for (entry, wrong, words) in [
        ("batch = 16", "batch = \"many\"", ["batch", "invalid type"]),
        ("batch = 16\n", "", ["batch", "found nothing"]),
        ("gamma = 3.0\n", "", ["gamma", "found nothing"]),
        ("bounds = ", "bounds = [nan, 0.0, 0.0, 1.0] #", ["bounds", "a radius from"]),
        ("background = ", "background = [nan, 0.0, 0.0] #", ["background", "NaN"]),
        ("background_spread = ", "background_spread = -1 #", ["background_spread", "0 or more"]),
        ("background = ", "background = [0.0, 0.0, 0.0, 7.0] #", ["background", "4 numbers"]),
        ("background_spread", "# background_spread", ["background_spread: ", "missing"]),
        ("iterations = 2", "iterations = 2\ntime = 9.0", ["time", "one of both"]),
        ("background_confidence = ", "background_confidence = 2 #", ["confidence", "0 to 1"]),
    ] {
        assert!(right.contains(entry), "{entry} in {right}");
        fs::write(&path, right.replacen(entry, wrong, 1)).unwrap();
        let resume = ["fit", "--resume", "-o", &run, "--iterations", "3"];
        refused(&resume, 2, &[&["fit.toml"], &words[..]].concat());
    }
}

#[test]
fn weights_of_a_wrong_shape_are_refused_with_their_shapes() {
    let folder = Folder::new();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/query");
    let mut bytes = fs::read(fixtures.join("softplus.safetensors")).unwrap();
    // In the changed header the encoded position joins one layer earlier than in the tensors.
    let (header, changed) = (br#""skip": "[2]""#, br#""skip": "[1]""#);
    let at = bytes.windows(header.len()).position(|w| w == header).unwrap();
    bytes[at..at + header.len()].copy_from_slice(changed);
    let model = folder.path("m.safetensors");
    fs::write(&model, bytes).unwrap();
    let points = fixtures.join("softplus.points.npy").to_string_lossy().into_owned();
    let words = ["m.safetensors", "layers.1.weight", "[33, 20]", "[33, 47]"];
    refused(&["query", &model, &points, "-o", &folder.path("o.npy")], 2, &words);
    let mut neural = scene();
    neural["sdf"] = json!({"type": "neural", "weights": "m.safetensors"});
    let path = folder.write("scene.json", &neural);
    refused(&["render", &path, "-o", &folder.path("o.png")], 2, &words);
    assert_eq!(folder.files(), 2, "a refused command writes no file");
}

#[test]
fn scene_of_unbounded_size_is_refused() {
    let folder = Folder::new();
    let mut huge = scene();
    huge["sdf"]["radius"] = json!(1e200);
    let path = folder.write("scene.json", &huge);
    refused(&["synth", &path, "-o", &folder.path("d"), "--views", "2"], 2, &["scene.json", "/sdf"]);
    assert_eq!(folder.files(), 1, "a refused command writes no file");
}
