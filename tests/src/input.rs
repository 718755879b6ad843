//! Input files of the tests, and the check of a refusal.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;

use serde_json::{Value, json};

use crate::{dsdf, dsdf_ok};

/// Runs `dsdf` and checks that it fails with `status` and prints one line with all words.
///
/// # Panics
/// If it does not.
pub fn refused(arguments: &[&str], status: i32, words: &[&str]) {
    let output = dsdf(arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{arguments:?}: {message}");
    for word in words {
        assert!(message.contains(word), "{arguments:?}: no {word:?} in {message}");
    }
    assert!(output.stdout.is_empty());
}

/// A ball on a film of 8 × 8 pixels.
pub fn scene() -> Value {
    json!({
        "camera": {"width": 8, "height": 8, "focal": 16, "principal": [4, 4], "eye": [0, 0, 4],
                   "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0, 0, 0], "radius": 0.7},
        "appearance": {"type": "constant", "radiance": [1, 1, 1]},
        "background": [0, 0, 0]
    })
}

/// A temporary folder.
#[derive(Debug)]
pub struct Folder(tempfile::TempDir);

impl Default for Folder {
    fn default() -> Self {
        Self::new()
    }
}

impl Folder {
    /// Creates the folder.
    ///
    /// # Panics
    /// If it cannot be created.
    pub fn new() -> Self {
        Folder(tempfile::tempdir().unwrap())
    }

    /// The path of a file in the folder.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_string_lossy().into_owned()
    }

    /// Writes JSON and returns the file's path.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn write(&self, name: &str, value: &Value) -> String {
        fs::write(self.0.path().join(name), value.to_string()).unwrap();
        self.path(name)
    }

    /// The number of files.
    ///
    /// # Panics
    /// If the folder cannot be read.
    pub fn files(&self) -> usize {
        fs::read_dir(self.0.path()).unwrap().count()
    }
}

/// Renders three views of 8 × 8 pixels, and returns the content of their `transforms.json`.
///
/// # Panics
/// If it cannot be rendered.
pub fn dataset(folder: &Folder) -> Value {
    for i in 0..3 {
        let path = folder.write("scene.json", &scene());
        assert!(
            dsdf(&["render", &path, "-o", &folder.path(&format!("{i}.png")), "--spp", "1"])
                .status
                .success()
        );
    }
    let matrix = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]);
    let frame =
        |i: i32| json!({"file_path": format!("{i}.png"), "transform_matrix": matrix.clone()});
    json!({"camera_angle_x": 0.5, "w": 8, "h": 8, "frames": [frame(0), frame(1), frame(2)]})
}

/// Renders `views` training views and a held-out one of a lit ball, 32 × 32 pixels, as a data set.
/// Returns its folder.
///
/// # Panics
/// If it cannot be rendered.
pub fn ball(folder: &Folder, views: &str) -> String {
    let scene = json!({
        "camera": {"width": 12, "height": 9, "focal": 20, "principal": [6, 4.5],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.1, 0, 0], "radius": 0.6},
        "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.3, 0.3, 0.3],
                       "lights": [{"type": "directional", "direction": [1, 1, 1],
                                   "radiance": [1, 1, 1]}]},
        "background": [0, 0, 0]
    });
    let (scene, data) = (folder.write("scene.json", &scene), folder.path("data"));
    let options = ["--views", views, "--size", "32x32", "--spp", "4"];
    dsdf_ok(&[&["synth", &scene, "-o", &data], &options[..]].concat());
    data
}

/// Fits the data set of a folder for two iterations, and returns the run's folder.
///
/// # Panics
/// If it fails.
pub fn fit_two_iterations(folder: &Folder) -> String {
    folder.write("transforms.json", &dataset(folder));
    let (data, run) = (folder.path(""), folder.path("run"));
    // Without a grid, it is still a ball.
    let options = ["--iterations", "2", "--batch", "16", "--bounds", "0,0,0,1", "--grid", "none"];
    dsdf_ok(&[&["fit", &data, "-o", &run], &options[..]].concat());
    run
}
