//! Derivative images against independent ones, and the main job at a tiny size.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::Command;

use tests::{dsdf, dsdf_json, npy, shared};

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
    // The published estimator's 22 points are a large bias for motion along the view.
    let radius_and_sideways = ["/sdf/radius", "/sdf/center/0"];
    derivative_images_match("refined", &["/sdf/radius", "/sdf/center/0", "/sdf/center/2"], 0.02);
    derivative_images_match("paper", &radius_and_sideways, 0.05);
    derivative_images_match("contour", &radius_and_sideways, 0.01);
}

fn derivative_images_match(estimator: &str, wrt: &[&str], allowed: f64) {
    for scene in ["sphere", "sphere_lambert"] {
        let Some(file) = shared(&format!("reference/gradients/{scene}.json")) else { return };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("g.npy").to_string_lossy().into_owned();
        let file_text = file.to_string_lossy();
        let mut arguments =
            vec!["gradient", &file_text, "--estimator", estimator, "--spp", "256", "-o", &out];
        wrt.iter().for_each(|wrt| arguments.extend(["--wrt", wrt]));
        let report = dsdf_json(&arguments);
        assert!(
            report["seconds"].as_f64().unwrap() > 0.0
                && report["evaluations"]["gradient"].as_u64().unwrap() > 0
        );
        for pointer in wrt.iter().map(|wrt| wrt.trim_start_matches('/').replace('/', "_")) {
            let want = npy(&file.with_file_name(format!("{scene}.d_{pointer}.npy")));
            let got = npy(&folder.path().join(format!("g.{pointer}.npy")));
            let error = error(&got, &want);
            println!("{scene} {pointer}, {estimator}: {error:.4}");
            assert!(error <= allowed, "{scene} {pointer}, {estimator}: relative L2 error {error}");
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
    let run = |estimator: &str, threads: &str| {
        let out = folder.path().join(format!("g{threads}.npy")).to_string_lossy().into_owned();
        let scene = scene.to_string_lossy();
        let flags = [
            "--wrt",
            "/sdf/major",
            "--spp",
            "16",
            "--estimator",
            estimator,
            "--threads",
            threads,
            "-o",
            &out,
        ];
        let output = dsdf(&[&["gradient", &scene], &flags[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).unwrap()
    };
    let all = [
        "refined",
        "paper",
        "paper-all",
        "interior",
        "gaussian",
        "was",
        "loubet",
        "band",
        "contour",
        "fd",
    ];
    for estimator in all {
        assert!(run(estimator, "1") == run(estimator, "2"), "{estimator}");
    }
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
    let output = dsdf(&[
        "synth",
        &scene.to_string_lossy(),
        "-o",
        &data,
        "--views",
        "6",
        "--size",
        "32x32",
        "--spp",
        "4",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    data
}

/// The iterations that a run's metrics tell of.
fn iterations(run: &Path) -> Vec<u64> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    let lines = text.lines().map_while(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    lines.filter_map(|v| v["iteration"].as_u64()).collect()
}

#[test]
fn a_killed_fit_goes_on_bit_for_bit() {
    const ITERATIONS: u64 = 120;
    let folder = tempfile::tempdir().unwrap();
    let data = synth(folder.path());
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let fit = |out: &str, more: &[&str]| {
        let count = ITERATIONS.to_string();
        let options = ["--batch", "64", "--checkpoint-every", "5", "--iterations", &count];
        let mut all = vec!["fit".to_owned(), "--output".to_owned(), out.to_owned()];
        if more.contains(&"--resume") {
            all.push("--resume".to_owned());
        } else {
            all.push(data.clone());
            all.extend(options.iter().chain(more).map(|s| (*s).to_owned()));
        }
        all
    };
    let finish = |arguments: &[String]| {
        let output = dsdf(arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    finish(&fit(&path("whole"), &[]));
    let killed = folder.path().join("killed");
    for (more, reach) in [("--threads=1", 12), ("--resume", 40)] {
        let mut child = Command::new(tests::binary())
            .args(fit(&path("killed"), &[more]))
            .arg("--quiet")
            .spawn()
            .unwrap();
        while iterations(&killed).last().is_none_or(|last| *last < reach) {
            assert!(child.try_wait().unwrap().is_none(), "it ended before iteration {reach}");
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        // SIGKILL: nothing of dsdf runs any more.
        child.kill().unwrap();
        child.wait().unwrap();
    }
    finish(&fit(&path("killed"), &["--resume"]));
    let read = |run: &str, name: &str| std::fs::read(folder.path().join(run).join(name)).unwrap();
    for name in ["model.safetensors", "radiance.safetensors"] {
        assert!(read("whole", name) == read("killed", name), "{name} differs");
    }
    assert_eq!(
        iterations(&killed),
        (1..=ITERATIONS).collect::<Vec<u64>>(),
        "nothing is told twice or lost"
    );
    finish(&fit(&path("killed"), &["--resume"]));
    assert!(
        read("whole", "model.safetensors") == read("killed", "model.safetensors"),
        "a finished run stays as it is"
    );
}

#[test]
fn a_fit_leaves_a_run_that_the_other_commands_read() {
    let folder = tempfile::tempdir().unwrap();
    let data = synth(folder.path());
    let run = folder.path().join("run").to_string_lossy().into_owned();
    let report = dsdf_json(&["fit", &data, "-o", &run, "--iterations", "30", "--batch", "128"]);
    assert_eq!(report["iterations"], 30);
    for name in [
        "model.safetensors",
        "fit.toml",
        "metrics.jsonl",
        "checkpoint/state.safetensors",
        "preview/000030.png",
    ] {
        assert!(Path::new(&run).join(name).exists(), "{name}");
    }
    let mesh = folder.path().join("m.glb").to_string_lossy().into_owned();
    assert_eq!(dsdf_json(&["mesh", &run, "-o", &mesh, "--resolution", "48"])["closed"], true);
    let truth = Path::new(&data).join("truth.ply").to_string_lossy().into_owned();
    let eval = dsdf_json(&["eval", &run, "--mesh", &truth, "--resolution", "48"]);
    for key in
        ["psnr", "ssim", "mask_iou", "chamfer", "chamfer_relative", "f_score", "normal_consistency"]
    {
        assert!(eval[key].is_number(), "{key} of {eval}");
    }
    let turntable = folder.path().join("t.png").to_string_lossy().into_owned();
    let report = dsdf_json(&[
        "render", &run, "-o", &turntable, "--views", "3", "--size", "24", "--spp", "1",
    ]);
    assert_eq!((&report["views"], &report["width"]), (&3.into(), &(3 * 24 + 2 * 4).into()));
    let inspect = folder.path().join("i.png").to_string_lossy().into_owned();
    let report = dsdf_json(&["inspect", &data, "-o", &inspect]);
    assert_eq!((report["train_views"].as_u64(), report["test_views"].as_u64()), (Some(6), Some(1)));
    assert!(Path::new(&inspect).exists());
}

/// Finite differences of a ball alone, smaller than a pixel: as it grows it leaves the bounds that
/// it had.
#[test]
fn differences_follow_a_growing_ball() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.json");
    let text = r#"{"camera": {"width": 8, "height": 8, "focal": 14, "principal": [4, 4], "eye": [0.1, 0.2, 4],
        "target": [0.02, 0.01, 0], "up": [0, 1, 0]}, "sdf": {"type": "sphere", "center": [0, 0, 0], "radius": 0.0141},
        "appearance": {"type": "constant", "radiance": [1, 1, 1]}, "background": [0, 0, 0]}"#;
    std::fs::write(&scene, text).unwrap();
    let total = |estimator: &str, spp: &str| {
        let out = folder.path().join("g.npy");
        let (scene, out_name) =
            (scene.to_string_lossy().into_owned(), out.to_string_lossy().into_owned());
        let by = ["--wrt", "/sdf/radius", "--estimator", estimator, "--spp", spp];
        dsdf_json(&[&["gradient", &scene, "-o", &out_name], &by[..]].concat());
        npy(&out).iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    let (differences, refined) = (total("fd", "65536"), total("refined", "1024"));
    assert!(
        (differences - refined).abs() < 0.05 * refined,
        "differences {differences}, refined {refined}"
    );
}
