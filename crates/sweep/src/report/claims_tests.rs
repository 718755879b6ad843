use super::*;

/// The results of a sweep over k = 2, 4, 7 with seeds 1 to 6. `chamfer` gives the Chamfer distance
/// for k and seed, in bounding radii, or `None` for a fit without a result.
fn results(chamfer: impl Fn(u32, u64) -> Option<f64>) -> Vec<CellResult> {
    let grid = [2, 4, 7].into_iter().flat_map(|k| (1..=6).map(move |seed| (k, seed)));
    grid.map(|(k, seed)| {
        let chamfer = chamfer(k, seed);
        CellResult {
            data: "a".to_owned(),
            values: vec![("k".to_owned(), k.to_string())],
            seed,
            status: "done".to_owned(),
            converged: chamfer.is_some_and(|c| c < 0.1),
            numbers: chamfer.iter().map(|c| ("chamfer".to_owned(), *c)).collect(),
            ..CellResult::default()
        }
    })
    .collect()
}

/// The verdict on a claim about k; `rest` holds further keys of the claim.
fn verdict(kind: &str, values: &str, rest: &str, results: &[CellResult]) -> Verdict {
    let text = format!(
        r#"
        title = "t"
        iterations = 1
        seeds = [1]
        parameters.k = [2, 4, 7]
        [[data]]
        name = "a"
        scene = "a"
        [[claim]]
        text = "c"
        kind = "{kind}"
        parameter = "k"
        values = {values}
        {rest}"#
    );
    let sweep: Sweep = toml::from_str(&text).unwrap();
    judge(&sweep, &sweep.claim[0], results).verdict
}

#[test]
fn verdicts_follow_the_evidence() {
    use Verdict::{Inconclusive, NotReproduced, Reproduced};
    let wobble = |seed: u64| 1.0 + 0.02 * (seed % 3) as f64;
    let clear = results(|k, seed| {
        Some(0.02 * wobble(seed) * if k == 2 { 3.0 + 0.1 * seed as f64 } else { 1.0 })
    });
    assert_eq!(verdict("worse", "[2]", "than = 7", &clear), Reproduced);
    assert_eq!(verdict("worse", "[4]", "than = 7", &clear), NotReproduced);
    assert_eq!(verdict("worse", "[2, 4]", "than = 7", &clear), NotReproduced);
    assert_eq!(verdict("little-gain", "[4]", "than = 7", &clear), Reproduced);
    assert_eq!(verdict("little-gain", "[7]", "than = 2", &clear), NotReproduced);
    assert_eq!(verdict("best", "[2]", "", &clear), NotReproduced);
    let noise = results(|_, seed| Some(0.02 * if seed % 2 == 0 { 5.0 } else { 1.0 }));
    let crossed =
        results(|k, seed| Some(0.02 * if (seed % 2 == 0) == (k == 2) { 5.0 } else { 1.0 }));
    assert_eq!(verdict("worse", "[2]", "than = 7", &crossed), Inconclusive);
    // Noise that both sides of a pair share cancels.
    assert_eq!(verdict("worse", "[2]", "than = 7", &noise), NotReproduced);
    let best = results(|k, seed| {
        Some(0.01 * f64::from(9 - k) * wobble(seed) + 1e-4 * (seed * u64::from(k)) as f64)
    });
    assert_eq!(verdict("best", "[7]", "", &best), Reproduced);
}

#[test]
fn fits_without_a_result_count_with_the_worst_number() {
    let failing = results(|k, _| (k != 2).then_some(0.02));
    assert_eq!(verdict("often-diverges", "[2]", "than = 7", &failing), Verdict::Reproduced);
    assert_eq!(
        verdict("often-diverges", "[4]", "than = 7", &failing),
        Verdict::Inconclusive,
        "0 of 6 does not exclude a quarter"
    );
    assert_eq!(verdict("worse", "[2]", "than = 7", &failing), Verdict::Reproduced);
    // Fits that fail at every value say nothing about one value, and give no pairs.
    let lost = results(|_, _| None);
    assert_eq!(verdict("often-diverges", "[2]", "than = 7", &lost), Verdict::Inconclusive);
    assert_eq!(verdict("little-gain", "[2]", "than = 7", &lost), Verdict::Inconclusive);
    // A gradient that was not measured gives no pair.
    let mut unknown = results(|_, _| Some(0.02));
    for result in unknown.iter_mut().filter(|r| r.value("k") == "7") {
        result.numbers.insert("last_bias".to_owned(), 0.5);
    }
    let metric = "than = 7\nmetric = \"last_bias\"";
    assert_eq!(verdict("worse", "[2]", metric, &unknown), Verdict::Inconclusive);
    assert_eq!(verdict("little-gain", "[2]", metric, &unknown), Verdict::Inconclusive);
}
