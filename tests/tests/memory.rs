//! The peak memory of derivative images. It depends neither on the samples per pixel nor on the
//! points along a ray.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use tests::{binary, root};

/// The largest resident set of `dsdf gradient` on a scene, in MiB.
fn peak(scene: &str, threads: &str, flags: &[&str]) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let mut child = Command::new(binary())
        .args(["gradient", scene, "--quiet", "--threads", threads, "-o"])
        .arg(folder.path().join("g.npy"))
        .args(flags)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0.0f64;
    // The system forgets the high-water mark with the process: it is read until the end.
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let mark = text
            .lines()
            .find_map(|l| l.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse::<f64>().ok());
        peak = mark.map_or(peak, |kib| peak.max(kib / 1024.0));
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(child.wait().unwrap().success(), "dsdf gradient {flags:?}");
    peak
}

/// The scene of a lit disc, on a film of `side` × `side` pixels. Returns its path in `folder`.
fn disc(folder: &Path, side: u32) -> String {
    let text = std::fs::read_to_string(root().join("tests/gradients/disc.lambert.json")).unwrap();
    let mut scene: serde_json::Value = serde_json::from_str(&text).unwrap();
    let camera = &mut scene["camera"];
    let factor = f64::from(side) / camera["width"].as_f64().unwrap();
    camera["width"] = side.into();
    camera["height"] = side.into();
    camera["focal"] = (camera["focal"].as_f64().unwrap() * factor).into();
    camera["principal"] = [side / 2, side / 2].to_vec().into();
    let path = folder.join("scene.json");
    std::fs::write(&path, scene.to_string()).unwrap();
    path.to_string_lossy().into_owned()
}

#[test]
fn memory_does_not_grow_with_samples_or_points() {
    let folder = tempfile::tempdir().unwrap();
    let scene = disc(folder.path(), 4);
    for estimator in ["refined", "paper"] {
        let at = |spp: &str, steps: &str| {
            let options = ["--estimator", estimator, "--spp", spp, "--steps", steps];
            // Two threads may need most memory at the same time or not: 51 to 99 MiB.
            peak(&scene, "1", &[&["--wrt", "/sdf/radius"], &options[..]].concat())
        };
        // With 4096 samples per pixel, each of four replicates has its full size of 1024.
        let (few, many, long) = (at("4096", "22"), at("32768", "22"), at("4096", "200"));
        println!(
            "{estimator}: {few:.0} MiB; {many:.0} with 8 times the samples, {long:.0} with 9 times \
             the points"
        );
        assert!(many < 1.5 * few, "{estimator}: {few} MiB with 4096 samples, {many} with 32768");
        assert!(long < 2.0 * few, "{estimator}: {few} MiB with 22 points, {long} with 200");
    }
}

#[test]
fn derivative_image_of_1024_pixels_squared_takes_less_than_a_gibibyte() {
    let folder = tempfile::tempdir().unwrap();
    let scene = disc(folder.path(), 1024);
    let mebibytes = peak(&scene, "2", &["--wrt", "/sdf/radius", "--spp", "4"]);
    assert!(mebibytes < 1024.0, "{mebibytes} MiB");
}
