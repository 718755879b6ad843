//! Reports of `dsdf gradient` name the terms that the estimator leaves out.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::process::Command;

use tests::binary;

/// A scene with this solid and appearance.
fn scene(sdf: &str, appearance: &str) -> String {
    format!(
        r#"{{"camera": {{"width": 8, "height": 8, "focal": 12, "principal": [4, 4],
                      "eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0]}},
            "sdf": {sdf}, "appearance": {appearance}, "background": [0, 0, 0]}}"#
    )
}

/// The list `unmodelled` of the report, and the warnings on standard error.
fn unmodelled(scene: &str, wrt: &str, estimator: &str) -> (Vec<String>, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (file, output) = (path("scene.json"), path("g.npy"));
    std::fs::write(&file, scene).unwrap();
    let arguments = ["gradient", &file, "--wrt", wrt, "--estimator", estimator, "-o", &output];
    let flags = ["--spp", "4", "--json"];
    let run = Command::new(binary()).args(arguments).args(flags).output().unwrap();
    let errors = String::from_utf8_lossy(&run.stderr);
    let warnings = errors.lines().filter(|line| line.starts_with("WARNING"));
    let lines: Vec<String> = warnings.map(str::to_owned).collect();
    assert!(run.status.success(), "{estimator}: {errors}");
    let report: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    let terms = report["unmodelled"].as_array().unwrap().iter();
    (terms.map(|term| term.as_str().unwrap().to_owned()).collect(), lines)
}

#[test]
fn a_report_names_the_terms_that_the_estimator_leaves_out() {
    let ball = r#"{"type": "sphere", "center": [0, 0, 0], "radius": 0.6}"#;
    let cube = r#"{"type": "box", "center": [0, 0, 0], "half_size": [0.5, 0.5, 0.5]}"#;
    let (normal, white) =
        (r#"{"type": "normal"}"#, r#"{"type": "constant", "radiance": [1, 1, 1]}"#);
    let (radius, size) = ("/sdf/radius", "/sdf/half_size/0");
    let (creases, silhouettes) = ("creases", "silhouettes");
    for (sdf, appearance, wrt, estimator, expected) in [
        (ball, normal, radius, "refined", &[][..]),
        (ball, normal, radius, "paper", &[]),
        (ball, normal, radius, "interior", &[silhouettes]),
        (cube, normal, size, "refined", &[]),
        (cube, normal, size, "contour", &[]),
        (cube, normal, size, "fd", &[]),
        (cube, normal, size, "paper", &[creases]),
        (cube, normal, size, "interior", &[silhouettes, creases]),
        (cube, white, size, "paper", &[]),
    ] {
        let (terms, lines) = unmodelled(&scene(sdf, appearance), wrt, estimator);
        assert_eq!(terms, expected, "{estimator}, {sdf}, {appearance}");
        let warning = format!("WARNING the estimator leaves out {}", expected.join(" and "));
        let expected_lines = if expected.is_empty() { vec![] } else { vec![warning] };
        assert_eq!(lines, expected_lines, "{estimator}, {sdf}, {appearance}");
    }
}
