//! Faults of the surroundings: files that are not regular, outputs and sizes that cannot be, files
//! of the user in the way, and processes that end in the middle of their work.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tests::input::{Folder, dataset, fit_two_iterations, refused, scene};
use tests::{dsdf, dsdf_ok};

/// Runs `dsdf` after some commands of a shell, for example with limits.
fn after(setup: &str, arguments: &[&str]) -> Output {
    let quoted: Vec<String> = arguments.iter().map(|a| format!("'{a}'")).collect();
    let dsdf = tests::binary();
    let command = format!("{setup}; exec '{}' {} --quiet", dsdf.display(), quoted.join(" "));
    Command::new("sh").args(["-c", &command]).output().unwrap()
}

/// The one line on standard error of a run that ended with `status`.
fn message(output: &Output, status: i32) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    text
}

fn make_pipe(path: &str) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
fn inputs_that_are_no_regular_files_are_refused_at_once() {
    let folder = Folder::new();
    let start = Instant::now();
    let (pipe, out) = (folder.path("pipe"), folder.path("o.npy"));
    make_pipe(&pipe);
    let points = folder.path("p.npy");
    for (file, found) in
        [(pipe.as_str(), "a pipe"), ("/dev/zero", "a device"), ("/proc/self/status", "/proc")]
    {
        refused(&["render", file, "-o", &out], 2, &[file, found]);
        refused(&["query", file, &points, "-o", &out], 2, &[file, found]);
        let neural = json!({"type": "neural", "weights": file});
        for part in ["sdf", "appearance"] {
            let mut s = scene();
            s[part] = neural.clone();
            refused(&["render", &folder.write("s.json", &s), "-o", &out], 2, &[file, found]);
        }
    }
    // The images of a data set, its masks and its camera file.
    folder.write("transforms.json", &dataset(&folder));
    let (data, picture) = (folder.path(""), folder.path("i.png"));
    for (name, word) in [("masks/1.png", "masks/1.png"), ("2.png", "2.png")] {
        fs::create_dir_all(folder.path("masks")).unwrap();
        let mut root: Value =
            serde_json::from_slice(&fs::read(folder.path("transforms.json")).unwrap()).unwrap();
        root["frames"][1]["mask_path"] = json!(name);
        folder.write("transforms.json", &root);
        let _ = fs::remove_file(folder.path(name));
        make_pipe(&folder.path(name));
        refused(&["inspect", &data, "-o", &picture], 2, &[word]);
    }
    fs::remove_file(folder.path("transforms.json")).unwrap();
    make_pipe(&folder.path("transforms.json"));
    refused(&["inspect", &data, "-o", &picture], 2, &["transforms.json", "a pipe"]);
    assert!(start.elapsed() < Duration::from_secs(30), "a refusal waits for nothing");
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_input_is_read() {
    let folder = Folder::new();
    let none = folder.path("none");
    let long = "x".repeat(300);
    for place in [folder.path(&long), format!("/proc/{}", &long[..9]), format!("{none}/a/b/c")] {
        let file = |extension: &str| format!("{place}.{extension}");
        let (png, npy, ply) = (file("png"), file("npy"), file("ply"));
        let by_two = ["--wrt", "/sdf/radius", "--wrt", "/sdf/center/0"];
        let words = ["output"];
        refused(&["render", &none, "-o", &png], 2, &words);
        refused(&[&["gradient", &none, "-o", &npy], &by_two[..]].concat(), 2, &words);
        refused(&["gradient", &none, "-o", &npy, "--wrt", "/sdf/radius"], 2, &words);
        refused(&["mesh", &none, "-o", &ply], 2, &words);
        refused(&["query", &none, &none, "-o", &npy], 2, &words);
        refused(&["inspect", &none, "-o", &png], 2, &words);
        if !place.starts_with(&none) {
            refused(&["synth", &none, "-o", &place], 2, &words);
            refused(&["fit", &none, "-o", &place], 2, &words);
            refused(&["demo", "-o", &place], 2, &words);
        }
    }
    // The name is short enough, and too long with the suffix of a pointer.
    let npy = folder.path(&format!("{}.npy", &long[..250]));
    let by_two = ["--wrt", "/sdf/radius", "--wrt", "/sdf/center/0"];
    refused(&[&["gradient", &none, "-o", &npy], &by_two[..]].concat(), 2, &["output"]);
    assert_eq!(folder.files(), 0);
}

#[test]
fn work_beyond_the_memory_is_refused_before_it_starts() {
    let folder = Folder::new();
    let mut large = scene();
    (large["camera"]["width"], large["camera"]["height"]) = (json!(16000), json!(16000));
    let path = folder.write("large.json", &large);
    let small = folder.write("scene.json", &scene());
    let run = fit_two_iterations(&folder);
    let (out, data) = (folder.path("o.npy"), folder.path(""));
    let files = folder.files();
    let refused = |arguments: &[&str], words: &[&str]| {
        // The limit of the address space, in KiB.
        let text = message(&after("ulimit -v 6000000", arguments), 2);
        let memory = ["of memory, expected at most 6.1 GB"];
        for word in words.iter().chain(&memory) {
            assert!(text.contains(word), "{arguments:?}: no {word:?} in {text}");
        }
    };
    let size = "16000 x 16000 pixels";
    refused(&["render", &path, "-o", &out], &["large.json: /camera", size]);
    refused(&["gradient", &path, "-o", &out, "--wrt", "/sdf/radius"], &["/camera", size]);
    refused(&["synth", &small, "-o", &folder.path("d"), "--size", "16000x16000"], &[size]);
    refused(&["render", &run, "-o", &out, "--size", "4096"], &["8 images of 4096 x 4096 pixels"]);
    let fit = ["fit", &data, "-o", &folder.path("r"), "--width", "4096", "--layers", "64"];
    refused(&fit, &["arguments: --width: found 64 layers of width 4096", "169.4 GB"]);
    assert_eq!(folder.files(), files, "a refused command writes no file");
    // The photographs of a camera file are counted before they are read.
    let mut root = dataset(&folder);
    (root["w"], root["h"]) = (json!(60000), json!(60000));
    folder.write("transforms.json", &root);
    (0..3).for_each(|i| fs::write(folder.path(&format!("{i}.png")), large_png(60000)).unwrap());
    let whole = ["inspect", &data, "-o", &folder.path("i.png"), "--downscale", "1"];
    refused(&whole, &["images: found 10800000000 pix"]);
}

/// The chunks of a PNG file of so many grey pixels a side, without the pixels.
fn large_png(side: u32) -> Vec<u8> {
    let chunk = |name: &[u8], content: &[u8]| {
        let body = [name, content].concat();
        let divided = |sum: u32| (sum >> 1) ^ (0xedb8_8320 & (sum & 1).wrapping_neg());
        let of_byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |s, _| divided(s));
        let sum = !body.iter().fold(!0, of_byte);
        [&(content.len() as u32).to_be_bytes()[..], &body, &sum.to_be_bytes()].concat()
    };
    let size = side.to_be_bytes();
    let header = chunk(b"IHDR", &[&size[..], &size, &[8, 0, 0, 0, 0]].concat());
    [b"\x89PNG\r\n\x1a\n".to_vec(), header, chunk(b"IDAT", b""), chunk(b"IEND", b"")].concat()
}

#[test]
fn a_fit_replaces_no_files_of_others() {
    let folder = Folder::new();
    folder.write("transforms.json", &dataset(&folder));
    let (data, run) = (folder.path(""), folder.path("run"));
    let options = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1"];
    let fit = [&["fit", &data, "-o", &run], &options[..]].concat();
    let results = ["model.safetensors", "background.safetensors", "preview/000002.png"];
    for name in ["fit.toml", "metrics.jsonl"].into_iter().chain(results) {
        let path = folder.path(&format!("run/{name}"));
        fs::create_dir_all(Path::new(&path).parent().unwrap()).unwrap();
        fs::write(&path, "mine").unwrap();
        refused(&fit, 2, &["run/", "a file that a new run would replace", "a new folder"]);
        assert_eq!(fs::read(&path).unwrap(), b"mine");
        fs::remove_dir_all(&run).unwrap();
    }
    // The demo replaces its own runs only.
    fs::create_dir_all(folder.path("demo/run")).unwrap();
    fs::write(folder.path("demo/run/model.safetensors"), "mine").unwrap();
    refused(&["demo", "-o", &folder.path("demo")], 2, &["model.safetensors", "replace"]);
    // The lock is a link to a file of the user.
    fs::create_dir(&run).unwrap();
    fs::write(folder.path("precious"), "mine").unwrap();
    std::os::unix::fs::symlink(folder.path("precious"), folder.path("run/lock")).unwrap();
    refused(&fit, 2, &["run/lock: lock: found a link"]);
    assert_eq!(fs::read(folder.path("precious")).unwrap(), b"mine");
    // Other files are no obstacle, and a lock keeps its content.
    fs::remove_file(folder.path("run/lock")).unwrap();
    fs::write(folder.path("run/lock"), "mine").unwrap();
    fs::write(folder.path("run/notes.txt"), "mine").unwrap();
    dsdf_ok(&fit);
    for name in ["run/lock", "run/notes.txt"] {
        assert_eq!(fs::read(folder.path(name)).unwrap(), b"mine", "{name}");
    }
    refused(&fit, 2, &["a run with a checkpoint", "--resume"]);
    // A link in place of a subfolder would lead a resumed fit to other files.
    fs::remove_dir_all(folder.path("run/preview")).unwrap();
    std::os::unix::fs::symlink(folder.path("masks"), folder.path("run/preview")).unwrap();
    let resume = ["fit", "--resume", "-o", &run, "--iterations", "4"];
    refused(&resume, 2, &["run/preview: run: found a link"]);
    fs::remove_dir_all(folder.path("run/checkpoint")).unwrap();
    refused(&fit, 2, &["model.safetensors", "a new folder"]);
}

#[test]
fn a_resumed_fit_keeps_its_metrics_and_removes_temporary_files() {
    let folder = Folder::new();
    folder.write("transforms.json", &dataset(&folder));
    let (data, run) = (folder.path(""), folder.path("run"));
    let options = ["--batch", "16", "--bounds", "0,0,0,1", "--iterations", "6"];
    let every = ["--preview-every", "2", "--checkpoint-every", "2"];
    let every = [&every[..], &["--stop-after", "3", "--held-out", "1"]].concat();
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..], &every[..]].concat());
    // A line of a crash, with a byte that is no text.
    let metrics = folder.path("run/metrics.jsonl");
    let mut bytes = fs::read(&metrics).unwrap();
    bytes.extend(b"{\"iteration\": 2, \"note\": \"\xff\"}\n{\"iteration\": -5}\n{\"iterat");
    fs::write(&metrics, bytes).unwrap();
    let mut ended = Command::new("true").spawn().unwrap();
    ended.wait().unwrap();
    let stale = ["", "checkpoint/", "preview/"]
        .map(|sub| folder.path(&format!("run/{sub}.dsdf-{}-a1b2c3.tmp", ended.id())));
    stale.iter().for_each(|path| fs::write(path, "half").unwrap());
    let own = folder.path("run/.dsdf-notes.tmp");
    fs::write(&own, "mine").unwrap();
    dsdf_ok(&["fit", "--resume", "-o", &run]);
    let text = fs::read_to_string(&metrics).unwrap();
    let lines: Vec<Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let iterations: Vec<u64> = lines.iter().map(|l| l["iteration"].as_u64().unwrap()).collect();
    assert_eq!(iterations, [1, 2, 3, 4, 5, 6]);
    // The preview after iteration 2 gives the PSNR until that after iteration 4.
    let psnr: Vec<Option<f64>> = lines.iter().map(|l| l["psnr"].as_f64()).collect();
    assert!(psnr[1].is_none() && psnr[2].is_some(), "{psnr:?}");
    assert!(psnr[3] == psnr[2] && psnr[4] != psnr[3], "{psnr:?}");
    for path in stale {
        assert!(!Path::new(&path).exists(), "{path}");
    }
    assert_eq!(fs::read(own).unwrap(), b"mine");
}

#[test]
fn a_full_disk_is_named_with_the_metrics_file() {
    let folder = Folder::new();
    folder.write("transforms.json", &dataset(&folder));
    let (data, run) = (folder.path(""), folder.path("run"));
    let options = ["--iterations", "500", "--batch", "16", "--bounds", "0,0,0,1"];
    let fit = [&["fit", &data, "-o", &run], &options[..]].concat();
    // A limit of the file size fails a write as a full disk does.
    let text = message(&after("trap '' XFSZ; ulimit -f 4", &fit), 1);
    assert!(text.contains("cannot write") && text.contains("metrics.jsonl"), "{text}");
}

#[test]
fn a_fit_without_a_surface_says_so_and_keeps_its_files() {
    let folder = Folder::new();
    folder.write("transforms.json", &dataset(&folder));
    for i in 0..3 {
        image::RgbImage::new(32, 32).save(folder.path(&format!("{i}.png"))).unwrap();
    }
    let camera = json!({"camera_angle_x": 0.5, "w": 32, "h": 32});
    let text = fs::read(folder.path("transforms.json")).unwrap();
    let mut root: Value = serde_json::from_slice(&text).unwrap();
    camera.as_object().unwrap().iter().for_each(|(key, value)| root[key] = value.clone());
    folder.write("transforms.json", &root);
    let (data, run) = (folder.path(""), folder.path("run"));
    let options =
        ["--iterations", "300", "--batch", "256", "--bounds", "0,0,0,1", "--held-out", "1"];
    refused(
        &[&["fit", &data, "-o", &run], &options[..]].concat(),
        1,
        &["run", "without a surface"],
    );
    for name in ["fit.toml", "model.safetensors", "checkpoint/state.safetensors", "metrics.jsonl"] {
        assert!(Path::new(&run).join(name).exists(), "{name}");
    }
    refused(&["fit", "--resume", "-o", &run], 1, &["without a surface"]);
    refused(&["mesh", &run, "-o", &folder.path("m.ply")], 2, &["no surface"]);
    refused(&["eval", &run], 1, &["no surface in a held-out view"]);
    // A network of another size than the checkpoint's is refused without building it.
    let options = fs::read_to_string(folder.path("run/fit.toml")).unwrap();
    let other = options.replace("width = 64", "width = 4096");
    assert_ne!(options, other);
    fs::write(folder.path("run/fit.toml"), other).unwrap();
    let start = Instant::now();
    refused(&["fit", "--resume", "-o", &run], 2, &["state.safetensors", "F32 of shape"]);
    assert!(start.elapsed() < Duration::from_secs(20), "a refusal builds no network");
}

#[test]
fn an_interrupted_write_leaves_no_temporary_file() {
    let folder = Folder::new();
    let mut large = scene();
    (large["camera"]["width"], large["camera"]["height"]) = (json!(4096), json!(4096));
    large["camera"]["principal"] = json!([-1e6, 0]);
    let (path, out) = (folder.write("large.json", &large), folder.path("o.npy"));
    let mut child = Command::new(tests::binary())
        .args(["render", &path, "-o", &out, "--spp", "1", "--quiet"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The file of 201 MB is being written.
    let is_writing = || {
        let files = fs::read_dir(folder.path("")).unwrap().flatten();
        files
            .filter_map(|f| f.metadata().ok().map(|m| (f.file_name(), m.len())))
            .any(|(name, n)| n > 1_000_000 && name.to_string_lossy().starts_with(".dsdf-"))
    };
    while !is_writing() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was seen to write");
    }
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupt.unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(folder.files(), 1, "only the scene is left");
}

#[test]
fn control_characters_of_files_do_not_reach_the_terminal() {
    let folder = Folder::new();
    let hidden = |output: &Output| {
        let text = [&output.stdout[..], &output.stderr].concat();
        let text = String::from_utf8(text).unwrap();
        let bad = text.chars().find(|c| c.is_control() && *c != '\n');
        assert!(bad.is_none(), "{bad:?} in {text}");
        text
    };
    let mut wrong = scene();
    wrong["sdf"]["type"] = json!("\u{1b}]0;title\u{7}\u{9b}2J");
    let path = folder.write("\u{1b}[31m.json", &wrong);
    let text = hidden(&dsdf(&["render", &path, "-o", &folder.path("o.png")]));
    assert!(text.contains("\\u{1b}") && text.contains("\\u{9b}"), "{text}");
    let text = hidden(&dsdf(&["render", &folder.path("\u{1b}[2J"), "-o", &folder.path("o.png")]));
    assert!(text.contains("\\u{1b}[2J"), "{text}");
    hidden(&dsdf(&["render", "--\u{1b}[2J"]));
    // Names in results, as text and as JSON.
    let path = folder.write("s.json", &scene());
    let out = folder.path("\u{9b}31m.npy");
    let gradient = ["gradient", &path, "--wrt", "/sdf/radius", "-o", &out, "--spp", "1", "--json"];
    let text = hidden(&dsdf(&gradient));
    let report: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["outputs"][0].as_str(), Some(out.as_str()));
    // A number of 300 digits.
    wrong["sdf"]["type"] = json!("sphere");
    wrong["background"] = json!([0, 0, 0]);
    let path = folder.write("s.json", &wrong);
    let gradient = ["gradient", &path, "--wrt", "/sdf/radius", "-o", &folder.path("o.npy")];
    refused(&[&gradient[..], &["--gamma", "-1e300"]].concat(), 2, &["found -1e300, "]);
}
