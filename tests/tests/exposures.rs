//! Fits of photographs with other exposures.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;

use serde_json::Value;
use tests::compose::{Kind, compose};

use tests::input::{Folder, refused};
use tests::{dsdf_json, dsdf_ok, root};

fn read(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The stops of the training views, less their mean.
fn stops(views: &Value, of: impl Fn(&Value) -> Option<f64>) -> Vec<f64> {
    let all: Vec<f64> = views.as_array().unwrap().iter().filter_map(of).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    all.iter().map(|stops| stops - mean).collect()
}

#[test]
fn a_fit_finds_the_exposures_of_photographs() {
    let folder = Folder::new();
    let (renders, data) = (folder.path("renders"), folder.path("data"));
    let scene = root().join("crates/app/src/cli/demo_scene.json");
    let scene = scene.to_str().unwrap();
    dsdf_ok(&["synth", scene, "-o", &renders, "--views", "12", "--size", "48x48", "--spp", "16"]);
    compose(Kind::GreyExposure, Path::new(&renders), Path::new(&data), 1, &mut |_| {}).unwrap();
    let fit = |run: &str, exposure: &str| {
        let options = ["--iterations", "500", "--batch", "192", "--exposure", exposure];
        dsdf_json(&[&["fit", &data, "-o", run], &options[..]].concat())
    };
    let (run, other) = (folder.path("run"), folder.path("other"));
    fit(&run, "per-view");
    fit(&other, "none");
    let truth = stops(&read(&format!("{data}/compose.json"))["views"], |view| {
        view["file"].as_str()?.starts_with("train").then(|| view["stops"].as_f64())?
    });
    let found = read(&format!("{run}/exposures.json"));
    for channel in 0..3 {
        let found = stops(&found["views"], |view| view["stops"][channel].as_f64());
        assert_eq!(found.len(), 12);
        let size = |all: &mut dyn Iterator<Item = f64>| all.map(f64::abs).sum::<f64>() / 12.0;
        let off = size(&mut found.iter().zip(&truth).map(|(a, b)| a - b));
        let spread = size(&mut truth.iter().copied());
        println!("channel {channel}: off by {off} of {spread} stops");
        assert!(off < 0.4 * spread, "channel {channel}: off by {off} of {spread} stops");
    }
    let psnr = |run: &str| dsdf_json(&["eval", run])["psnr"].as_f64().unwrap();
    let [with, without] = [psnr(&run), psnr(&other)];
    println!("{with} dB with exposures, {without} dB without");
    assert!(with > without + 1.0, "{with} and {without} dB");
    assert!(!Path::new(&format!("{other}/exposures.json")).exists());
    fs::write(format!("{run}/exposures.json"), r#"{"views": []}"#).unwrap();
    refused(&["eval", &run], 2, &["exposures.json: exposures: ", "found nothing"]);
}
