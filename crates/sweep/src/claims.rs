//! Claims judged by paired comparisons: the same data set, seed and other parameters on both sides.

use std::collections::{BTreeMap, BTreeSet};

use super::results::{Better, Metric, Row, metric};
use super::statistics::{Mean, ratio, share};
use super::sweep::{Sweep, text};
use super::tables::{Claim, Kind};

/// What became of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Reproduced,
    NotReproduced,
    Inconclusive,
}

impl Verdict {
    pub(super) fn name(self) -> &'static str {
        match self {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::Inconclusive => "inconclusive",
        }
    }
}

/// A verdict with what it rests on, a line each.
#[derive(Clone, Debug)]
pub(super) struct Judged {
    pub(super) verdict: Verdict,
    pub(super) evidence: Vec<String>,
}

/// A share of fits that do not converge that counts as often.
const OFTEN: f64 = 0.25;

/// How much worse `value` is than `than`: the ratio of the metric, above 1 where worse, of pairs of
/// rows that differ in nothing else.
///
/// Fits of one seed on one data set start alike whatever their parameters: their pairs are one
/// observation, the mean.
pub(super) fn worse(
    rows: &[Row],
    parameter: &str,
    value: &str,
    than: &str,
    metric: &Metric,
) -> Mean {
    let mut blocks: BTreeMap<(&str, u64), Vec<f64>> = BTreeMap::new();
    for row in rows.iter().filter(|r| r.value(parameter) == value) {
        let others =
            |r: &Row| r.values.iter().filter(|(k, _)| k != parameter).cloned().collect::<Vec<_>>();
        let partner = rows.iter().find(|r| {
            r.value(parameter) == than
                && r.data == row.data
                && r.seed == row.seed
                && others(r) == others(row)
        });
        if let Some(partner) = partner {
            let known = |r: &Row| r.numbers.contains_key(metric.name);
            // A maximum would take what is not known for the least.
            let at_least = |v: f64| if v.is_nan() { v } else { v.max(metric.least) };
            let log = (at_least(error(row, metric)) / at_least(error(partner, metric))).ln();
            // Two fits without a result say nothing of each other, and costs that are not known are
            // no costs.
            if log.is_finite() && (known(row) || known(partner)) {
                blocks.entry((&row.data, row.seed)).or_default().push(log);
            }
        }
    }
    let logs: Vec<f64> =
        blocks.values().map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
    ratio(&logs)
}

/// A metric as a positive number that is smaller where it is better: a ratio of decibels says
/// nothing, one of errors does.
pub(super) fn error(row: &Row, metric: &Metric) -> f64 {
    let v = row.number(metric);
    match (metric.name, metric.better) {
        ("psnr", _) => 10f64.powf(-v / 20.0),
        (_, Better::More) => 1.0 - v,
        _ => v,
    }
}

/// Judges a claim by the rows of its sweep.
pub(super) fn judge(sweep: &Sweep, claim: &Claim, rows: &[Row]) -> Judged {
    let fits = |row: &&Row| claim.only.iter().all(|(k, v)| row.value(k) == text(v));
    let rows: Vec<Row> = rows.iter().filter(fits).cloned().collect();
    let Some(metric) = metric(&claim.metric) else {
        return Judged { verdict: Verdict::Inconclusive, evidence: Vec::new() };
    };
    let values: Vec<String> = claim.values.iter().map(text).collect();
    let than = claim.than.as_ref().map(text).unwrap_or_default();
    let mut evidence = Vec::new();
    let mut compare = |value: &str, than: &str, judge: &dyn Fn(Mean) -> Verdict| {
        let found = worse(&rows, &claim.parameter, value, than, metric);
        let verdict = judge(found);
        evidence.push(format!(
            "{} = {value} against {than}: {} {} of it ({} to {}, {} data sets and seeds, p = {}): {}",
            claim.parameter,
            error_name(metric),
            percent(found.mean),
            percent(found.low),
            percent(found.high),
            found.count,
            short(found.p),
            verdict.name()
        ));
        verdict
    };
    let margin = 1.0 + claim.margin;
    let verdicts: Vec<Verdict> = match claim.kind {
        Kind::Best => {
            let others = sweep.values(&claim.parameter).into_iter().filter(|v| !values.contains(v));
            // The others are worse, by however little.
            others
                .map(|other| compare(&other, &values[0], &|m| decide(m.low > 1.0, m.high < 1.0)))
                .collect()
        }
        Kind::Worse => {
            let judge = |m: Mean| decide(m.low > 1.0 && m.mean >= margin, m.high < margin);
            values.iter().map(|v| compare(v, &than, &judge)).collect()
        }
        Kind::LittleGain => {
            let judge = |m: Mean| decide(m.low > 1.0 / margin, m.high < 1.0 / margin);
            values.iter().map(|v| compare(v, &than, &judge)).collect()
        }
        Kind::OftenDiverges => {
            let of = |v: &String| {
                rows.iter().filter(|r| r.value(&claim.parameter) == v).collect::<Vec<_>>()
            };
            values
                .iter()
                .map(|value| {
                    let own = of(value);
                    let failed = own.iter().filter(|r| !r.converged).count();
                    let seen = failed as f64 / own.len().max(1) as f64;
                    // As above, those of one data set and seed are one observation.
                    let blocks: BTreeSet<(&str, u64)> = own.iter().map(|r| (r.data.as_str(), r.seed)).collect();
                    let (low, high) = share(seen, blocks.len());
                    // What fails at the other value too is not this value's doing.
                    let control = of(&than);
                    let usual = control.iter().filter(|r| !r.converged).count() as f64 / control.len().max(1) as f64;
                    let verdict = decide(seen >= OFTEN && low > usual.max(0.05), high < OFTEN);
                    evidence.push(format!(
                        "{} = {value}: {failed} of {} do not converge ({} to {}, {} data sets and seeds; {} at {than}): {}",
                        claim.parameter,
                        own.len(),
                        percent(low),
                        percent(high),
                        blocks.len(),
                        percent(usual),
                        verdict.name()
                    ));
                    verdict
                })
                .collect()
        }
    };
    Judged { verdict: all(&verdicts), evidence }
}

fn decide(yes: bool, no: bool) -> Verdict {
    match (yes, no) {
        (true, _) => Verdict::Reproduced,
        (_, true) => Verdict::NotReproduced,
        _ => Verdict::Inconclusive,
    }
}

/// All must hold; one that does not ends it.
fn all(verdicts: &[Verdict]) -> Verdict {
    if verdicts.contains(&Verdict::NotReproduced) {
        Verdict::NotReproduced
    } else if verdicts.iter().all(|v| *v == Verdict::Reproduced) && !verdicts.is_empty() {
        Verdict::Reproduced
    } else {
        Verdict::Inconclusive
    }
}

/// What the ratio is of.
pub(super) fn error_name(metric: &Metric) -> String {
    match (metric.name, metric.better) {
        ("psnr", _) => "RMS error of held-out views".to_owned(),
        (name, Better::More) => format!("1 − {name}"),
        ("chamfer" | "loss" | "best_loss", _) => {
            metric.label.split(',').next().unwrap_or_default().to_owned()
        }
        _ => metric.label.to_owned(),
    }
}

pub(super) fn percent(v: f64) -> String {
    if v.is_finite() { format!("{:.0} %", 100.0 * v) } else { "?".to_owned() }
}

pub(super) fn short(p: f64) -> String {
    if p < 1e-3 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

#[cfg(test)]
#[path = "claims_tests.rs"]
mod tests;
