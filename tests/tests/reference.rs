//! Derivative images against independent ones, and the main job at a tiny size.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;

use tests::{dsdf, dsdf_json, shared};

/// The numbers of a float32 .npy file.
fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Relative L2 error; a reference of one channel stands for all three.
fn error(got: &[f32], want: &[f32]) -> f64 {
    let channels = got.len() / want.len();
    let (mut difference, mut square) = (0.0, 0.0);
    for (i, got) in got.iter().enumerate() {
        let want = f64::from(want[i / channels]);
        difference += (f64::from(*got) - want).powi(2);
        square += want * want;
    }
    (difference / square).sqrt()
}

#[test]
fn derivative_images_match_independent_ones() {
    for scene in ["sphere", "sphere_lambert"] {
        let Some(file) = shared(&format!("reference/gradients/{scene}.json")) else { return };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("g.npy");
        let (file_text, out_text) = (file.to_string_lossy(), out.to_string_lossy());
        let arguments =
            ["gradient", &file_text, "--wrt", "/sdf/radius", "--wrt", "/sdf/center/0", "--spp", "256", "-o", &out_text];
        let report = dsdf_json(&arguments);
        assert!(
            report["seconds"].as_f64().unwrap() > 0.0 && report["evaluations"]["hessian_vector"].as_u64().unwrap() > 0
        );
        for pointer in ["sdf_radius", "sdf_center_0"] {
            let want = npy(&file.with_file_name(format!("{scene}.d_{pointer}.npy")));
            let got = npy(&folder.path().join(format!("g.{pointer}.npy")));
            let error = error(&got, &want);
            println!("{scene} {pointer}: {error:.4}");
            assert!(error <= 0.05, "{scene} {pointer}: relative L2 error {error}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_on_one_and_two_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.json");
    let text = r#"{"camera": {"width": 12, "height": 9, "focal": 20, "principal": [6, 4.5], "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "torus", "center": [0, 0, 0], "axis": [0.2, 1, 0.4], "major": 0.6, "minor": 0.2},
        "appearance": {"type": "normal"}, "background": [0.1, 0.2, 0.3]}"#;
    std::fs::write(&scene, text).unwrap();
    let run = |threads: &str| {
        let out = folder.path().join(format!("g{threads}.npy"));
        let output = dsdf(&[
            "gradient".as_ref(),
            scene.as_os_str(),
            "--wrt".as_ref(),
            "/sdf/major".as_ref(),
            "-o".as_ref(),
            out.as_os_str(),
            "--threads".as_ref(),
            threads.as_ref(),
        ]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).unwrap()
    };
    assert_eq!(run("1"), run("2"));
}

/// A tiny data set of a sphere.
fn synth(folder: &Path) -> String {
    let scene = folder.join("scene.json");
    let text = r#"{"camera": {"width": 12, "height": 9, "focal": 20, "principal": [6, 4.5], "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.1, 0, 0], "radius": 0.6},
        "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.3, 0.3, 0.3], "lights": [{"type": "directional", "direction": [1, 1, 1], "radiance": [1, 1, 1]}]},
        "background": [0, 0, 0]}"#;
    std::fs::write(&scene, text).unwrap();
    let data = folder.join("data").to_string_lossy().into_owned();
    let output =
        dsdf(&["synth", &scene.to_string_lossy(), "-o", &data, "--views", "6", "--size", "32x32", "--spp", "4"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    data
}

/// The tensors of a model file, without the header, whose strings come in any order.
fn tensors(path: &Path) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    bytes[8 + header..].to_vec()
}

#[test]
fn a_resumed_fit_goes_on_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let data = synth(folder.path());
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name).to_string_lossy().into_owned();
        let mut arguments = vec!["fit", &data, "-o", &out, "--batch", "64", "--checkpoint-every", "5"];
        arguments.extend(more);
        let output = dsdf(&arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        tensors(&folder.path().join(name).join("model.safetensors"))
    };
    let whole = run("whole", &["--iterations", "12"]);
    // A run that is killed leaves the checkpoint of iteration 10; here it is copied while the run is whole.
    run("half", &["--iterations", "12", "--threads", "1"]);
    let half = folder.path().join("half");
    assert_eq!(tensors(&half.join("model.safetensors")), whole, "threads change nothing");
    let resumed = run("half", &["--resume"]);
    assert_eq!(resumed, whole, "a finished run stays as it is");
}

#[test]
fn a_fit_leaves_a_run_that_the_other_commands_read() {
    let folder = tempfile::tempdir().unwrap();
    let data = synth(folder.path());
    let run = folder.path().join("run").to_string_lossy().into_owned();
    let report = dsdf_json(&["fit", &data, "-o", &run, "--iterations", "30", "--batch", "128"]);
    assert_eq!(report["iterations"], 30);
    for name in ["model.safetensors", "fit.toml", "metrics.jsonl", "checkpoint/state.safetensors", "preview/000030.png"]
    {
        assert!(Path::new(&run).join(name).exists(), "{name}");
    }
    let mesh = folder.path().join("m.glb").to_string_lossy().into_owned();
    assert_eq!(dsdf_json(&["mesh", &run, "-o", &mesh, "--resolution", "48"])["closed"], true);
    let truth = Path::new(&data).join("truth.ply").to_string_lossy().into_owned();
    let eval = dsdf_json(&["eval", &run, "--mesh", &truth, "--resolution", "48"]);
    for key in ["psnr", "ssim", "mask_iou", "chamfer", "chamfer_relative", "f_score", "normal_consistency"] {
        assert!(eval[key].is_number(), "{key} of {eval}");
    }
    let inspect = folder.path().join("i.png").to_string_lossy().into_owned();
    let report = dsdf_json(&["inspect", &data, "-o", &inspect]);
    assert_eq!((report["train_views"].as_u64(), report["test_views"].as_u64()), (Some(6), Some(1)));
    assert!(Path::new(&inspect).exists());
}
