//! Photographs of more pixels than a fit can use, and photographs that are missing.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::process::Command;

use serde_json::json;
use tests::input::{Folder, dataset, refused};
use tests::{binary, dsdf_json};

/// Runs `dsdf` without `--quiet` and returns its lines about the size of images.
fn said(arguments: &[&str]) -> Vec<String> {
    let output = Command::new(binary()).args(arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    text.lines().filter(|line| line.starts_with("images: ")).map(str::to_owned).collect()
}

#[test]
fn a_fit_reads_large_photographs_smaller_and_says_and_records_it() {
    let folder = Folder::new();
    // Two views are both for training: 8.4 million pixels.
    image::GrayImage::from_fn(2100, 2000, |x, y| image::Luma([u8::from(x > 600 && y > 700) * 200]))
        .save(folder.path("view.png"))
        .unwrap();
    let matrix = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]);
    let frame = json!({"file_path": "view.png", "transform_matrix": matrix});
    folder.write("transforms.json", &json!({"camera_angle_x": 0.5, "frames": vec![frame; 2]}));
    let (data, run) = (folder.path(""), folder.path("run"));

    let short = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1"];
    let lines = said(&[&["fit", &data, "-o", &run], &short[..]].concat());
    assert_eq!(lines.len(), 1, "{lines:?}");
    for words in ["read at 1/2 of their size (1050 x 1000 pixels)", "budget", "--downscale 1"] {
        assert!(lines[0].contains(words), "no {words:?} in {lines:?}");
    }
    let path = folder.path("run/fit.toml");
    let recorded = std::fs::read_to_string(&path).unwrap();
    assert!(recorded.contains("\ndownscale = 2\n"), "{recorded}");
    let picture = folder.path("inspect.png");
    let size = |path: &str, more: &[&str]| {
        let arguments = [&["inspect", path, "-o", &picture], more].concat();
        dsdf_json(&arguments)["image_size"].clone()
    };
    assert_eq!([size(&run, &[]), size(&data, &[])], [json!([1050, 1000]), json!([1050, 1000])]);
    assert_eq!(size(&data, &["--downscale", "1"]), json!([2100, 2000]));

    // A larger budget could use more pixels. The run keeps its own.
    let resume = ["fit", "--resume", "-o", &run, "--iterations", "3"];
    assert!(said(&resume).is_empty());
    let other = [&resume[..], &["--downscale", "1"]].concat();
    refused(&other, 2, &["arguments: --downscale: found 1, expected 2, as in", "fit.toml"]);
    // Runs of earlier builds have the entry, too. Without it the size would be a guess.
    std::fs::write(&path, recorded.replace("downscale = 2\n", "")).unwrap();
    refused(&["eval", &run], 2, &["fit.toml", "downscale", "found nothing"]);
}

/// Runs `dsdf` and returns its warnings.
fn warnings(arguments: &[&str]) -> Vec<String> {
    let output = Command::new(binary()).args(arguments).output().unwrap();
    let (said, printed) = (output.stderr, output.stdout);
    let text = [String::from_utf8_lossy(&said), String::from_utf8_lossy(&printed)].concat();
    assert!(output.status.success(), "{text}");
    text.lines().filter(|line| line.starts_with("WARNING")).map(str::to_owned).collect()
}

#[test]
fn a_missing_photograph_is_a_warning_of_inspect_and_fit_and_most_of_them_an_error() {
    let folder = Folder::new();
    let mut root = dataset(&folder);
    root["frames"][1]["file_path"] = json!("images/gone.png");
    // A camera file may be named itself, in every command.
    let data = folder.write("transforms_noisy.json", &root);
    let note = "1 of 3 images is missing and left out: images/gone.png";
    let picture = folder.path("inspect.png");
    let bounds = ["--bounds", "0,0,0,1"];
    let found = warnings(&[&["inspect", &data, "-o", &picture], &bounds[..]].concat());
    assert!(found.iter().any(|line| line.ends_with(note)), "{found:?}");
    let run = folder.path("run");
    let short = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1"];
    let found = warnings(&[&["fit", &data, "-o", &run], &short[..]].concat());
    assert!(found.iter().any(|line| line.ends_with(note)), "{found:?}");
    dsdf_json(&["eval", &run, "--dataset", &data]);
    dsdf_json(&["inspect", &run, "-o", &picture]);
    let report = dsdf_json(&[&["inspect", &data, "-o", &picture][..], &bounds].concat());
    assert_eq!(report["warnings"][0], note);
    root["frames"][2]["file_path"] = json!("images/gone too.png");
    let data = folder.write("transforms_noisy.json", &root);
    let words = ["2 of 3 missing", "images/gone.png", "at least half"];
    refused(&["fit", &data, "-o", &folder.path("other")], 2, &words);
    refused(&["inspect", &data, "-o", &picture], 2, &words);
    assert!(!std::path::Path::new(&folder.path("other")).exists());
}
