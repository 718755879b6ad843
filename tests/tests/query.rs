//! `dsdf query` against a NumPy program that shares no code with dsdf (fixtures/query/make.py).
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;

use tests::{dsdf_json, npy};

/// The largest relative difference over all rows, of the columns as a vector.
///
/// The unit is the vector's length, but at least the root mean square over all rows: near a zero of
/// f no relative accuracy is possible.
fn error(got: &[f32], want: &[f32], columns: std::ops::Range<usize>) -> f64 {
    let part = |v: &[f32], row: usize| -> Vec<f64> {
        v[4 * row..4 * row + 4][columns.clone()].iter().map(|v| f64::from(*v)).collect()
    };
    let length = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let rows = want.len() / 4;
    let root_mean_square =
        ((0..rows).map(|r| length(&part(want, r)).powi(2)).sum::<f64>() / rows as f64).sqrt();
    (0..rows)
        .map(|r| {
            let (got, want) = (part(got, r), part(want, r));
            let difference: Vec<f64> = got.iter().zip(&want).map(|(a, b)| a - b).collect();
            length(&difference) / length(&want).max(root_mean_square)
        })
        .fold(0.0, f64::max)
}

#[test]
fn values_and_gradients_match_an_independent_program() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/query");
    let folder = tempfile::tempdir().unwrap();
    for name in ["softplus", "sine"] {
        let file =
            |end: &str| fixtures.join(format!("{name}.{end}")).to_string_lossy().into_owned();
        let out =
            |end: &str| folder.path().join(format!("{name}.{end}")).to_string_lossy().into_owned();
        let (model, points) = (file("safetensors"), file("points.npy"));
        let report = dsdf_json(&["query", &model, &points, "-o", &out("g.npy"), "--gradient"]);
        assert_eq!(report["points"], 200);
        dsdf_json(&["query", &model, &points, "-o", &out("f.npy")]);
        let (got, want) = (npy(Path::new(&out("g.npy"))), npy(Path::new(&file("expected.npy"))));
        assert_eq!(got.len(), want.len());
        let (value, gradient) = (error(&got, &want, 0..1), error(&got, &want, 1..4));
        println!("{name}: value {value:.1e}, gradient {gradient:.1e}");
        assert!(value < 1e-5 && gradient < 1e-4, "{name}: value {value:e}, gradient {gradient:e}");
        // Without --gradient the values are the same up to rounding.
        let alone = npy(Path::new(&out("f.npy")));
        assert!(
            alone.iter().zip(got.chunks(4)).all(|(f, row)| (f - row[0]).abs() < 1e-5),
            "{name}"
        );
    }
}
