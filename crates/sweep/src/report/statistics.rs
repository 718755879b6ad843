//! Confidence intervals of means and proportions.

use statrs::distribution::{Beta, ContinuousCDF, StudentsT};

/// The confidence level of all intervals.
pub(crate) const LEVEL: f64 = 0.95;

/// A mean with its confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    /// The mean itself.
    pub(crate) mean: f64,
    /// Lower end; −∞ for fewer than two values.
    pub(crate) low: f64,
    /// Upper end; +∞ for fewer than two values.
    pub(crate) high: f64,
    /// Number of values.
    pub(crate) count: usize,
    /// The p value of Student's two-sided t-test that the true mean is zero.
    pub(crate) p: f64,
}

/// The mean of independent values, with an interval by Student's t distribution.
pub(crate) fn mean_interval(values: &[f64]) -> Interval {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    let error = (variance / n).sqrt();
    let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
    let unbounded = Interval { mean, low, high, count: values.len(), p: 1.0 };
    if values.len() < 2 || !error.is_finite() {
        return unbounded;
    }
    if error == 0.0 {
        let p = if mean == 0.0 { 1.0 } else { 0.0 };
        return Interval { low: mean, high: mean, p, ..unbounded };
    }
    let Ok(student) = StudentsT::new(0.0, 1.0, n - 1.0) else { return unbounded };
    let half = student.inverse_cdf(0.5 + 0.5 * LEVEL) * error;
    let p = 2.0 * student.cdf(-(mean / error).abs());
    Interval { low: mean - half, high: mean + half, p, ..unbounded }
}

/// The geometric mean of ratios with its interval, from the ratios' natural logarithms.
pub(crate) fn geometric_mean(logs: &[f64]) -> Interval {
    let mean = mean_interval(logs);
    Interval { mean: mean.mean.exp(), low: mean.low.exp(), high: mean.high.exp(), ..mean }
}

/// The exact interval of a proportion `seen` among `count` observations: C. J. Clopper and
/// E. S. Pearson, "The use of confidence or fiducial limits illustrated in the case of the
/// binomial", Biometrika 26, 1934.
///
/// `seen * count` need not be whole: the beta quantiles interpolate between whole numbers.
pub(crate) fn proportion_interval(seen: f64, count: usize) -> (f64, f64) {
    let (tail, n) = (0.5 * (1.0 - LEVEL), count as f64);
    let hits = seen * n;
    let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map(|beta| beta.inverse_cdf(p));
    // With no hits the lower end is 0, with hits only the upper end is 1: no beta distribution.
    let low = quantile(hits, n - hits + 1.0, tail).unwrap_or(0.0);
    let high = quantile(hits + 1.0, n - hits, 1.0 - tail).unwrap_or(1.0);
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_match_published_tables() {
        // t for 95 % and 4 degrees of freedom is 2.776; the error of 1..5 is √(2.5/5).
        let m = mean_interval(&[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!((m.high - 3.0 - 2.776 * 0.5f64.sqrt()).abs() < 1e-3, "{m:?}");
        assert!((m.p - 0.0132).abs() < 2e-4, "{m:?}");
        assert_eq!(mean_interval(&[2.0]).high, f64::INFINITY);
        assert_eq!(mean_interval(&[2.0, 2.0]).low, 2.0);
        let r = geometric_mean(&[2f64.ln(), 2f64.ln(), 2.2f64.ln()]);
        assert!(r.mean > 2.0 && r.mean < 2.1 && r.low > 1.0);
        // 0 of 10: 1 − 0.025^(1/10); 3 of 10 from tables.
        let (low, high) = proportion_interval(0.0, 10);
        assert!(low == 0.0 && (high - 0.3085).abs() < 1e-3, "{high}");
        let (low, high) = proportion_interval(0.3, 10);
        assert!((low - 0.0667).abs() < 1e-3 && (high - 0.6525).abs() < 1e-3, "{low} {high}");
        assert_eq!(proportion_interval(1.0, 10).1, 1.0);
    }
}
