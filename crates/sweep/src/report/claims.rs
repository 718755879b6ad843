//! Verdicts on claims, by paired comparisons.

use std::collections::BTreeSet;

use crate::report::metrics::{Metric, metric};
use crate::report::options::text;
use crate::report::pairs::{error_name, error_ratio, p_value, percent};
use crate::report::results::CellResult;
use crate::report::schema::{Claim, ClaimKind};
use crate::report::statistics::{Interval, proportion_interval};
use crate::report::sweep::Sweep;

/// The verdict on a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The results confirm the claim.
    Reproduced,
    /// The results contradict it.
    NotReproduced,
    /// The intervals are too wide for a verdict.
    Inconclusive,
}

impl Verdict {
    /// The verdict in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::Inconclusive => "inconclusive",
        }
    }

    /// The verdict from a criterion for and a criterion against a claim.
    fn of(reproduced: bool, not_reproduced: bool) -> Self {
        match (reproduced, not_reproduced) {
            (true, _) => Verdict::Reproduced,
            (_, true) => Verdict::NotReproduced,
            _ => Verdict::Inconclusive,
        }
    }

    /// The verdict on a claim about several values: it must hold for all of them, and one value
    /// that contradicts it decides.
    fn all(verdicts: &[Verdict]) -> Self {
        if verdicts.contains(&Verdict::NotReproduced) {
            Verdict::NotReproduced
        } else if verdicts.iter().all(|v| *v == Verdict::Reproduced) && !verdicts.is_empty() {
            Verdict::Reproduced
        } else {
            Verdict::Inconclusive
        }
    }
}

/// A verdict with its evidence, one line for each comparison.
#[derive(Clone, Debug)]
pub(crate) struct Judgement {
    pub(crate) verdict: Verdict,
    pub(crate) evidence: Vec<String>,
}

/// The share of fits without convergence from which "often" holds.
const OFTEN: f64 = 0.25;

/// The share of fits without convergence that counts as usual, even if none fails at the value of
/// the comparison.
const USUAL: f64 = 0.05;

/// Judges a claim by the results of its sweep.
pub(crate) fn judge(sweep: &Sweep, claim: &Claim, results: &[CellResult]) -> Judgement {
    let selected = |r: &&CellResult| claim.only.iter().all(|(k, v)| r.value(k) == text(v));
    let results: Vec<CellResult> = results.iter().filter(selected).cloned().collect();
    let Some(metric) = metric(&claim.metric) else {
        return Judgement { verdict: Verdict::Inconclusive, evidence: Vec::new() };
    };
    let values: Vec<String> = claim.values.iter().map(text).collect();
    let than = claim.than.as_ref().map(text).unwrap_or_default();
    let mut judge = Judge { claim, metric, results: &results, evidence: Vec::new() };
    let verdicts: Vec<Verdict> = match claim.kind {
        ClaimKind::Best => {
            let others = sweep.values(&claim.parameter).into_iter().filter(|v| !values.contains(v));
            others.map(|other| judge.compare(&other, &values[0])).collect()
        }
        ClaimKind::Worse | ClaimKind::LittleGain => {
            values.iter().map(|value| judge.compare(value, &than)).collect()
        }
        ClaimKind::OftenDiverges => {
            values.iter().map(|value| judge.count_divergence(value, &than)).collect()
        }
    };
    Judgement { verdict: Verdict::all(&verdicts), evidence: judge.evidence }
}

/// A claim under judgement, with the results that count and the evidence so far.
struct Judge<'a> {
    claim: &'a Claim,
    metric: &'a Metric,
    results: &'a [CellResult],
    evidence: Vec<String>,
}

impl Judge<'_> {
    /// Compares the errors at two values of the claim's parameter.
    fn compare(&mut self, value: &str, than: &str) -> Verdict {
        let ratio = error_ratio(self.results, &self.claim.parameter, value, than, self.metric);
        let verdict = self.verdict_on(ratio);
        self.evidence.push(format!(
            "{} = {value} against {than}: {} {} of it ({} to {}, {} data sets and seeds, \
             p = {}): {}",
            self.claim.parameter,
            error_name(self.metric),
            percent(ratio.mean),
            percent(ratio.low),
            percent(ratio.high),
            ratio.count,
            p_value(ratio.p),
            verdict.name()
        ));
        verdict
    }

    /// The verdict on the ratio of the error at one value to the error at the other.
    fn verdict_on(&self, ratio: Interval) -> Verdict {
        let margin = 1.0 + self.claim.margin;
        match self.claim.kind {
            // The other value is worse, by any margin.
            ClaimKind::Best => Verdict::of(ratio.low > 1.0, ratio.high < 1.0),
            ClaimKind::Worse => {
                Verdict::of(ratio.low > 1.0 && ratio.mean >= margin, ratio.high < margin)
            }
            ClaimKind::LittleGain => {
                Verdict::of(ratio.low > 1.0 / margin, ratio.high < 1.0 / margin)
            }
            ClaimKind::OftenDiverges => Verdict::Inconclusive,
        }
    }

    /// The results at a value of the claim's parameter, and the share that did not converge.
    fn divergence(&self, value: &str) -> (Vec<&CellResult>, usize, f64) {
        let own: Vec<&CellResult> =
            self.results.iter().filter(|r| r.value(&self.claim.parameter) == value).collect();
        let failed = own.iter().filter(|r| !r.converged).count();
        let share = failed as f64 / own.len().max(1) as f64;
        (own, failed, share)
    }

    /// Compares the share of fits that do not converge with a quarter, and with the share at the
    /// other value: fits that fail at both values say nothing about this one.
    fn count_divergence(&mut self, value: &str, than: &str) -> Verdict {
        let (own, failed, share) = self.divergence(value);
        let (_, _, usual) = self.divergence(than);
        // Fits of one data set and seed are dependent: they count as one observation.
        let blocks: BTreeSet<(&str, u64)> = own.iter().map(|r| (r.data.as_str(), r.seed)).collect();
        let (low, high) = proportion_interval(share, blocks.len());
        let verdict = Verdict::of(share >= OFTEN && low > usual.max(USUAL), high < OFTEN);
        let line = format!(
            "{} = {value}: {failed} of {} do not converge ({} to {}, {} data sets and seeds; \
             {} at {than}): {}",
            self.claim.parameter,
            own.len(),
            percent(low),
            percent(high),
            blocks.len(),
            percent(usual),
            verdict.name()
        );
        self.evidence.push(line);
        verdict
    }
}

#[cfg(test)]
#[path = "claims_tests.rs"]
mod tests;
