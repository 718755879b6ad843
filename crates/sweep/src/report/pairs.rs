//! Paired comparisons: fits that differ in one parameter only.

use std::collections::BTreeMap;

use crate::report::metrics::{Better, Metric};
use crate::report::results::CellResult;
use crate::report::statistics::{Interval, geometric_mean};

/// The ratio of the error at `value` to the error at `than`, above 1 where `value` is worse, over
/// pairs of results that differ in `parameter` only.
///
/// Fits of one seed on one data set start alike at all parameters, so their pairs are dependent:
/// they count as one observation, their geometric mean.
pub(crate) fn error_ratio(
    results: &[CellResult],
    parameter: &str,
    value: &str,
    than: &str,
    metric: &Metric,
) -> Interval {
    let mut logs: BTreeMap<(&str, u64), Vec<f64>> = BTreeMap::new();
    for result in results.iter().filter(|r| r.value(parameter) == value) {
        let partner =
            results.iter().find(|r| r.value(parameter) == than && pair(r, result, parameter));
        if let Some(log) = partner.and_then(|partner| log_ratio(result, partner, metric)) {
            logs.entry((&result.data, result.seed)).or_default().push(log);
        }
    }
    let means: Vec<f64> =
        logs.values().map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
    geometric_mean(&means)
}

/// Whether two results agree in data set, seed and all parameters but one.
fn pair(a: &CellResult, b: &CellResult, parameter: &str) -> bool {
    let others = |r: &CellResult| -> Vec<(String, String)> {
        r.values.iter().filter(|(k, _)| k != parameter).cloned().collect()
    };
    a.data == b.data && a.seed == b.seed && others(a) == others(b)
}

/// The logarithm of the ratio of two results' errors, or `None` if the pair gives no information:
/// both results lack the metric, or the metric has no worst number and one result lacks it.
fn log_ratio(result: &CellResult, partner: &CellResult, metric: &Metric) -> Option<f64> {
    // f64::max would turn an unknown error (NaN) into the least one.
    let at_least = |v: f64| if v.is_nan() { v } else { v.max(metric.least) };
    let log = (at_least(error(result, metric)) / at_least(error(partner, metric))).ln();
    (log.is_finite() && (result.has(metric) || partner.has(metric))).then_some(log)
}

/// A metric as a positive error, so that a ratio has a meaning: a score s becomes 1 − s, a PSNR
/// the root mean square error.
pub(crate) fn error(result: &CellResult, metric: &Metric) -> f64 {
    let v = result.number(metric);
    match (metric.name, metric.better) {
        ("psnr", _) => 10f64.powf(-v / 20.0),
        (_, Better::More) => 1.0 - v,
        _ => v,
    }
}

/// The name of a metric's error (see [`error`]).
pub(crate) fn error_name(metric: &Metric) -> String {
    match (metric.name, metric.better) {
        ("psnr", _) => "RMS error of held-out views".to_owned(),
        (name, Better::More) => format!("1 − {name}"),
        ("chamfer" | "loss" | "best_loss", _) => {
            metric.label.split(',').next().unwrap_or_default().to_owned()
        }
        _ => metric.label.to_owned(),
    }
}

/// A ratio in whole percent; `?` for an infinite one.
pub(crate) fn percent(v: f64) -> String {
    if v.is_finite() { format!("{:.0} %", 100.0 * v) } else { "?".to_owned() }
}

/// A p value with three decimals.
pub(crate) fn p_value(p: f64) -> String {
    if p < 1e-3 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}
