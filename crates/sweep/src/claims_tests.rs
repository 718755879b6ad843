use super::*;
use crate::sweep::Sweep;

/// A sweep over k with two seeds, whose Chamfer distances are given by k and seed.
fn rows(of: impl Fn(u32, u64) -> Option<f64>) -> Vec<Row> {
    let mut rows = Vec::new();
    for (k, seed) in [2, 4, 7].into_iter().flat_map(|k| (1..=6).map(move |seed| (k, seed))) {
        let chamfer = of(k, seed);
        let row = serde_json::json!({
            "data": "a", "values": [["k", k.to_string()]], "seed": seed, "status": "done", "reason": "",
            "converged": chamfer.is_some_and(|c| c < 0.1),
            "numbers": chamfer.map_or(serde_json::json!({}), |c| serde_json::json!({"chamfer": c}))
        });
        rows.push(serde_json::from_value(row).unwrap());
    }
    rows
}

fn verdict(kind: &str, values: &str, rest: &str, rows: &[Row]) -> Verdict {
    let text = format!(
        "title = \"t\"\niterations = 1\nseeds = [1]\n[parameters]\nk = [2, 4, 7]\n[[data]]\nname = \"a\"\nscene = \"a\"\n\
         [[claim]]\ntext = \"c\"\nkind = \"{kind}\"\nparameter = \"k\"\nvalues = {values}\n{rest}"
    );
    let sweep: Sweep = toml::from_str(&text).unwrap();
    judge(&sweep, &sweep.claim[0], rows).verdict
}

#[test]
fn verdicts_follow_the_evidence() {
    use Verdict::{Inconclusive, NotReproduced, Reproduced};
    let wobble = |seed: u64| 1.0 + 0.02 * (seed % 3) as f64;
    let clear = rows(|k, seed| {
        Some(0.02 * wobble(seed) * if k == 2 { 3.0 + 0.1 * seed as f64 } else { 1.0 })
    });
    assert_eq!(verdict("worse", "[2]", "than = 7", &clear), Reproduced);
    assert_eq!(verdict("worse", "[4]", "than = 7", &clear), NotReproduced);
    assert_eq!(verdict("worse", "[2, 4]", "than = 7", &clear), NotReproduced);
    assert_eq!(verdict("little-gain", "[4]", "than = 7", &clear), Reproduced);
    assert_eq!(verdict("little-gain", "[7]", "than = 2", &clear), NotReproduced);
    assert_eq!(verdict("best", "[2]", "", &clear), NotReproduced);
    let noise = rows(|_, seed| Some(0.02 * if seed % 2 == 0 { 5.0 } else { 1.0 }));
    let crossed = rows(|k, seed| Some(0.02 * if (seed % 2 == 0) == (k == 2) { 5.0 } else { 1.0 }));
    assert_eq!(verdict("worse", "[2]", "than = 7", &crossed), Inconclusive);
    // Paired, noise that both sides share does not matter.
    assert_eq!(verdict("worse", "[2]", "than = 7", &noise), NotReproduced);
    let best = rows(|k, seed| {
        Some(0.01 * f64::from(9 - k) * wobble(seed) + 1e-4 * (seed * u64::from(k)) as f64)
    });
    assert_eq!(verdict("best", "[7]", "", &best), Reproduced);
}

#[test]
fn fits_without_a_result_count() {
    let failing = rows(|k, _| (k != 2).then_some(0.02));
    assert_eq!(verdict("often-diverges", "[2]", "than = 7", &failing), Verdict::Reproduced);
    assert_eq!(
        verdict("often-diverges", "[4]", "than = 7", &failing),
        Verdict::Inconclusive,
        "0 of 6 may be a quarter"
    );
    assert_eq!(verdict("worse", "[2]", "than = 7", &failing), Verdict::Reproduced);
    // What fails everywhere says nothing of one value, and compares with nothing.
    let lost = rows(|_, _| None);
    assert_eq!(verdict("often-diverges", "[2]", "than = 7", &lost), Verdict::Inconclusive);
    assert_eq!(verdict("little-gain", "[2]", "than = 7", &lost), Verdict::Inconclusive);
    // A gradient that was not measured is neither good nor bad.
    let mut unknown = rows(|_, _| Some(0.02));
    for row in unknown.iter_mut().filter(|row| row.value("k") == "7") {
        row.numbers.insert("last_bias".to_owned(), 0.5);
    }
    let metric = "than = 7\nmetric = \"last_bias\"";
    assert_eq!(verdict("worse", "[2]", metric, &unknown), Verdict::Inconclusive);
    assert_eq!(verdict("little-gain", "[2]", metric, &unknown), Verdict::Inconclusive);
}
