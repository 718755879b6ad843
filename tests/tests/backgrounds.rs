//! Backgrounds that are functions of the ray: trained by a fit, kept by its run, shown by a scene.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;

use serde_json::{Value, json};
use tests::input::{Folder, dataset, refused, scene};
use tests::{dsdf_ok, npy};

const KINDS: [&str; 2] = ["volume", "direction"];

/// A run of `iterations` with a trained background. Returns its folder.
fn fit(folder: &Folder, kind: &str, iterations: &str, name: &str) -> String {
    folder.write("transforms.json", &dataset(folder));
    let (data, run) = (folder.path(""), folder.path(name));
    let options = ["--batch", "32", "--bounds", "0,0,0,1", "--preview-every", "1"];
    let own = ["fit", &data, "-o", &run, "--background", kind, "--iterations", iterations];
    dsdf_ok(&[&own[..], &options[..]].concat());
    run
}

#[test]
fn a_resumed_fit_trains_its_background_with_the_same_bits() {
    for kind in KINDS {
        let folder = Folder::new();
        // The surface is soft for the first half of the iterations.
        let whole = fit(&folder, kind, "4", "whole");
        let parts = fit(&folder, kind, "1", "parts");
        let state = |run: &str| {
            ["model", "radiance", "background"]
                .map(|file| fs::read(format!("{run}/{file}.safetensors")).unwrap())
        };
        let first = state(&parts);
        dsdf_ok(&["fit", "--resume", "-o", &parts, "--iterations", "4"]);
        assert!(first[2] != state(&parts)[2], "{kind}: the background is trained");
        // One iteration of one is soft, as is the first of four: the schedules agree on it up to
        // the sharpness at progress 0.
        assert!(state(&whole) == state(&parts), "{kind}: other bits after a resumption");
        dsdf_ok(&["render", &whole, "-o", &folder.path("turn.png"), "--size", "16"]);
    }
}

#[test]
fn a_fit_resumed_after_a_survey_of_the_surface_has_the_same_bits() {
    let folder = Folder::new();
    folder.write("transforms.json", &dataset(&folder));
    let (data, whole, parts) = (folder.path(""), folder.path("whole"), folder.path("parts"));
    // The surface is surveyed at a progress of 0.5, 0.6 and 0.8: pixels far from it are grouped,
    // and nodes near it become free.
    let options = ["--batch", "32", "--bounds", "0,0,0,1", "--iterations", "12"];
    let fit = ["fit", &data, "--background", "direction"];
    dsdf_ok(&[&fit[..], &options[..], &["-o", &whole]].concat());
    dsdf_ok(&[&fit[..], &options[..], &["-o", &parts, "--stop-after", "9"]].concat());
    let checkpoint = format!("{parts}/checkpoint/state.safetensors");
    let saved = fs::read(&checkpoint).unwrap();
    dsdf_ok(&["fit", "--resume", "-o", &parts]);
    let model = |run: &str| fs::read(format!("{run}/model.safetensors")).unwrap();
    assert!(model(&whole) == model(&parts), "other bits after a resumption");

    // The flags of the checkpoint are those that the fit goes on with.
    let length = u64::from_le_bytes(saved[..8].try_into().unwrap()) as usize;
    let header: Value = serde_json::from_slice(&saved[8..8 + length]).unwrap();
    let place = header["is_far"]["data_offsets"].as_array().unwrap();
    let [from, to] = [0, 1].map(|i| 8 + length + place[i].as_u64().unwrap() as usize);
    let resumed_with = |flag: &dyn Fn(u8) -> u8| {
        let mut bytes = saved.clone();
        bytes[from..to].iter_mut().for_each(|byte| *byte = flag(*byte));
        let run = folder.path("flags");
        let _ = fs::remove_dir_all(&run);
        dsdf_ok(&[&fit[..], &options[..], &["-o", &run, "--stop-after", "9"]].concat());
        fs::write(format!("{run}/checkpoint/state.safetensors"), bytes).unwrap();
        run
    };
    let others = resumed_with(&|byte| 1 - byte);
    dsdf_ok(&["fit", "--resume", "-o", &others]);
    assert!(model(&whole) != model(&others), "the flags have no effect");
    let wrong = resumed_with(&|_| 2);
    refused(&["fit", "--resume", "-o", &wrong], 2, &["is_far", "found 2, expected 0 or 1"]);
}

#[test]
fn a_scene_shows_the_background_of_a_run() {
    let folder = Folder::new();
    for kind in KINDS {
        let run = fit(&folder, kind, "3", kind);
        let weights = format!("{run}/background.safetensors");
        let mut scene = scene();
        scene["background"] = json!({"type": kind, "weights": weights});
        if kind == "volume" {
            scene["background"]["center"] = json!([0, 0, 0]);
            scene["background"]["radius"] = json!(1);
        }
        let (file, out) = (folder.write("s.json", &scene), folder.path("o.npy"));
        dsdf_ok(&["render", &file, "-o", &out]);
        let image = npy(out.as_ref());
        let corner = &image[..3];
        assert!(corner.iter().all(|v| (0.0..1.0).contains(v)), "{kind}: {corner:?}");
        assert!(image.chunks(3).any(|pixel| pixel != corner), "{kind}: a varying image");
        // The derivative by a channel has no meaning there.
        let wrt = ["gradient", &file, "--wrt", "/background/0", "-o", &out];
        refused(&wrt, 2, &["/background/0"]);
    }
}

#[test]
fn a_run_with_a_background_of_another_kind_is_refused() {
    let folder = Folder::new();
    let runs = KINDS.map(|kind| fit(&folder, kind, "1", kind));
    let [volume, direction] = runs.map(|run| (format!("{run}/background.safetensors"), run));
    fs::copy(direction.0, volume.0).unwrap();
    let words = ["background.safetensors: background", "found direction, expected volume"];
    refused(&["mesh", &volume.1, "-o", &folder.path("m.ply")], 2, &words);
}

#[test]
fn wrong_backgrounds_of_scenes_are_refused() {
    let folder = Folder::new();
    let run = fit(&folder, "volume", "1", "run");
    let weights = format!("{run}/background.safetensors");
    let out = folder.path("o.png");
    let check = |background: Value, words: &[&str]| {
        let mut scene = scene();
        scene["background"] = background;
        refused(&["render", &folder.write("s.json", &scene), "-o", &out], 2, words);
    };
    let model = format!("{run}/model.safetensors");
    check(json!({"type": "sky"}), &["/background/type", "constant, direction or volume"]);
    check(json!({"type": "direction", "weights": weights}), &["found volume, expected direction"]);
    check(
        json!({"type": "direction", "weights": model}),
        &["model.safetensors", "background file"],
    );
    check(json!({"type": "direction", "weights": "none"}), &["none"]);
    check(json!({"type": "volume", "weights": weights}), &["/background/center"]);
    let (center, radius) = ([0, 0, 0], 0);
    let point = json!({"type": "volume", "weights": weights, "center": center, "radius": radius});
    check(point, &["/background/radius", "above 0"]);
    check(json!({"type": "constant", "radiance": [0, 0]}), &["/background/radiance"]);
}

#[test]
fn a_constant_background_may_be_an_object() {
    let folder = Folder::new();
    let derivative = |background: Value, wrt: &str| {
        let mut scene = scene();
        scene["background"] = background;
        let (file, out) = (folder.write("s.json", &scene), folder.path("o.npy"));
        dsdf_ok(&["gradient", &file, "--wrt", wrt, "-o", &out]);
        npy(out.as_ref())
    };
    let (array, object) = (
        derivative(json!([0.1, 0.2, 0.3]), "/background/1"),
        derivative(
            json!({"type": "constant", "radiance": [0.1, 0.2, 0.3]}),
            "/background/radiance/1",
        ),
    );
    assert!(array == object && array.iter().any(|v| *v > 0.5));
}
