//! The recommended setting of a sweep: the fastest one that is as good as the best one.

use std::fmt::Write;

use crate::report::metrics::{Metric, metric};
use crate::report::options::Settings;
use crate::report::pairs::{error, error_name, error_ratio, percent};
use crate::report::results::{CellResult, describe};
use crate::report::statistics::Interval;

/// Two tolerances as ratios: the largest error of a recommended setting in units of the best one's
/// error, and the largest time in units of the least time among those settings.
const NEAR: f64 = 1.05;

/// The parameter that stands for a whole setting, so that settings can be compared in pairs.
const SETTING: &str = "setting";

/// A combination of values with its means over data sets and seeds.
struct RankedSetting {
    values: Settings,
    /// The geometric mean of the error.
    error: f64,
    /// Mean time of a fit in seconds; infinite if unknown.
    seconds: f64,
    /// Mean field evaluations of a fit, in values of f; infinite if unknown.
    passes: f64,
    /// Whether all fits converged.
    converged: bool,
    /// The ratio of the error to that of the best setting, from pairs.
    ratio: Interval,
}

impl RankedSetting {
    /// Whether the setting always converged and is as good as the best one.
    fn is_near_best(&self) -> bool {
        let ratio = &self.ratio;
        self.converged && ratio.count > 1 && ratio.low <= 1.0 && ratio.mean <= NEAR
    }
}

/// Writes the section "Recommendation": a sentence, and a table of all settings.
///
/// The metric is the Chamfer distance, or PSNR if no true surface is known.
pub(crate) fn recommendation(out: &mut String, results: &[CellResult]) {
    let has_chamfer = results.iter().any(|r| r.numbers.contains_key("chamfer"));
    let Some(metric) = metric(if has_chamfer { "chamfer" } else { "psnr" }) else { return };
    // A data set without a true surface has no distances to it.
    let has_metric = |data: &str| results.iter().any(|r| r.data == data && r.has(metric));
    let results: Vec<CellResult> =
        results.iter().filter(|r| has_metric(&r.data)).cloned().collect();
    let Some(settings) = rank(&results, metric) else { return };
    write_choice(out, &settings, metric);
    write_table(out, &settings, metric);
}

/// All settings with their means, the best one first; `None` without results.
fn rank(results: &[CellResult], metric: &Metric) -> Option<Vec<RankedSetting>> {
    let mut settings: Vec<Settings> = Vec::new();
    for result in results {
        if !settings.contains(&result.values) {
            settings.push(result.values.clone());
        }
    }
    // A setting's index is the value of one parameter that replaces all others.
    let indexed: Vec<CellResult> = results
        .iter()
        .map(|r| {
            let index = settings.iter().position(|s| *s == r.values).unwrap_or(0);
            CellResult { values: vec![(SETTING.to_owned(), index.to_string())], ..r.clone() }
        })
        .collect();
    let errors: Vec<f64> =
        (0..settings.len()).map(|index| mean_error(&of_setting(&indexed, index), metric)).collect();
    let best = (0..settings.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]))?;
    let mut ranked: Vec<RankedSetting> = settings
        .into_iter()
        .enumerate()
        .map(|(index, values)| {
            let own = of_setting(&indexed, index);
            let (index_name, best) = (index.to_string(), best.to_string());
            RankedSetting {
                values,
                error: errors[index],
                seconds: mean_cost(&own, |r| r.numbers.get("seconds").copied()),
                passes: mean_cost(&own, CellResult::passes),
                converged: own.iter().all(|r| r.converged),
                ratio: error_ratio(&indexed, SETTING, &index_name, &best, metric),
            }
        })
        .collect();
    ranked.sort_by(|a, b| a.error.total_cmp(&b.error));
    Some(ranked)
}

/// The results of the setting with this index.
fn of_setting(indexed: &[CellResult], index: usize) -> Vec<&CellResult> {
    let name = index.to_string();
    indexed.iter().filter(|r| r.value(SETTING) == name).collect()
}

/// The geometric mean of the error.
fn mean_error(results: &[&CellResult], metric: &Metric) -> f64 {
    let logs: Vec<f64> = results.iter().map(|r| error(r, metric).max(metric.least).ln()).collect();
    (logs.iter().sum::<f64>() / logs.len() as f64).exp()
}

/// The mean of a cost over the results that have it; infinite if none has.
fn mean_cost(results: &[&CellResult], cost: impl Fn(&CellResult) -> Option<f64>) -> f64 {
    let known: Vec<f64> = results.iter().filter_map(|r| cost(r)).collect();
    if known.is_empty() {
        return f64::INFINITY;
    }
    known.iter().sum::<f64>() / known.len() as f64
}

/// Writes the recommended setting: of those near the best, the best one whose time is near the
/// least. Closer times are not told apart.
fn write_choice(out: &mut String, settings: &[RankedSetting], metric: &Metric) {
    let candidates = || settings.iter().filter(|s| s.is_near_best());
    let least = candidates().map(|s| s.seconds).fold(f64::INFINITY, f64::min);
    let _ = writeln!(out, "## Recommendation\n");
    let Some(chosen) = candidates().find(|s| s.seconds <= NEAR * least) else {
        let _ = writeln!(out, "None: there are no repeats, or no setting always converged.\n");
        return;
    };
    let _ = writeln!(
        out,
        "**{}**: the fastest setting, within 5 %, of those that always converged and are as good \
         as the best one: the {} relative to the best has a 95 % interval that is not wholly \
         above 100 %, and a mean of at most 105 %.\n",
        describe(&chosen.values),
        error_name(metric)
    );
}

fn write_table(out: &mut String, settings: &[RankedSetting], metric: &Metric) {
    let _ = writeln!(
        out,
        "| setting | {} (geometric mean) | relative to the best, 95 % | seconds \
         | evaluations, M values |\n|---|---|---|---|---|",
        error_name(metric)
    );
    for setting in settings {
        let _ = writeln!(
            out,
            "| {} | {:.3} % | {} ({} to {}) | {} | {} |",
            describe(&setting.values),
            100.0 * setting.error,
            percent(setting.ratio.mean),
            percent(setting.ratio.low),
            percent(setting.ratio.high),
            cost(setting.seconds, 1),
            cost(setting.passes / 1e6, 0)
        );
    }
    let _ = writeln!(
        out,
        "\nThe seconds depend on the machine and on its other work. The evaluations of f are \
         counted: a gradient as 2 values, a Hessian–vector product as 4, a parameter gradient \
         as 6.\n"
    );
}

/// A cost with this number of decimals; `-` if it is unknown.
fn cost(v: f64, decimals: usize) -> String {
    if v.is_finite() { format!("{v:.decimals$}") } else { "-".to_owned() }
}
