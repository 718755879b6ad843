//! Photographs of more pixels than a fit can use.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::process::Command;

use serde_json::json;
use tests::input::{Folder, refused};
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
    refused(&other, 2, &["fit.toml", "downscale", "found 1", "2, the value of this run"]);
    // Runs of earlier builds have the entry, too. Without it the size would be a guess.
    std::fs::write(&path, recorded.replace("downscale = 2\n", "")).unwrap();
    refused(&["eval", &run], 2, &["fit.toml", "downscale", "found nothing"]);
}
