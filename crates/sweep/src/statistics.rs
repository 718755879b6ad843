//! Means over seeds, and comparisons of pairs.

use statrs::distribution::{Beta, ContinuousCDF, StudentsT};

/// The level of all intervals.
pub(super) const LEVEL: f64 = 0.95;

/// A mean with its confidence interval; infinite for fewer than two values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mean {
    pub(super) mean: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) count: usize,
    /// The probability of a mean as far from zero or further, if the true one were zero: Student's
    /// test.
    pub(super) p: f64,
}

/// The mean of independent values, by Student's distribution.
pub(super) fn mean(values: &[f64]) -> Mean {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    let error = (variance / n).sqrt();
    let unknown =
        Mean { mean, low: f64::NEG_INFINITY, high: f64::INFINITY, count: values.len(), p: 1.0 };
    if values.len() < 2 || !error.is_finite() {
        return unknown;
    }
    if error == 0.0 {
        return Mean { low: mean, high: mean, p: if mean == 0.0 { 1.0 } else { 0.0 }, ..unknown };
    }
    let Ok(student) = StudentsT::new(0.0, 1.0, n - 1.0) else { return unknown };
    let half = student.inverse_cdf(0.5 + 0.5 * LEVEL) * error;
    let p = 2.0 * student.cdf(-(mean / error).abs());
    Mean { low: mean - half, high: mean + half, p, ..unknown }
}

/// The geometric mean of ratios, from their logarithms.
pub(super) fn ratio(logs: &[f64]) -> Mean {
    let mean = mean(logs);
    Mean { mean: mean.mean.exp(), low: mean.low.exp(), high: mean.high.exp(), ..mean }
}

/// The interval of a share that `count` observations show (Clopper and Pearson). A part of an
/// observation counts as such.
pub(super) fn share(seen: f64, count: usize) -> (f64, f64) {
    let (tail, n) = (0.5 * (1.0 - LEVEL), count as f64);
    let hits = seen * n;
    let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map(|beta| beta.inverse_cdf(p));
    // None and all have no distribution on their own side.
    let low = quantile(hits, n - hits + 1.0, tail).unwrap_or(0.0);
    let high = quantile(hits + 1.0, n - hits, 1.0 - tail).unwrap_or(1.0);
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_tables() {
        // t for 95 % and 4 degrees of freedom is 2.776; the error of 1..5 is √(2.5/5).
        let m = mean(&[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!((m.high - 3.0 - 2.776 * 0.5f64.sqrt()).abs() < 1e-3, "{m:?}");
        assert!((m.p - 0.0132).abs() < 2e-4, "{m:?}");
        assert_eq!(mean(&[2.0]).high, f64::INFINITY);
        assert_eq!(mean(&[2.0, 2.0]).low, 2.0);
        let r = ratio(&[2f64.ln(), 2f64.ln(), 2.2f64.ln()]);
        assert!(r.mean > 2.0 && r.mean < 2.1 && r.low > 1.0);
        // 0 of 10: 1 − 0.025^(1/10); 3 of 10 from tables.
        let (low, high) = share(0.0, 10);
        assert!(low == 0.0 && (high - 0.3085).abs() < 1e-3, "{high}");
        let (low, high) = share(0.3, 10);
        assert!((low - 0.0667).abs() < 1e-3 && (high - 0.6525).abs() < 1e-3, "{low} {high}");
        assert_eq!(share(1.0, 10).1, 1.0);
    }
}
