//! The curves of a run's metrics.

use std::path::Path;

use files::InputError;
use serde::{Deserialize, Serialize};

/// The most points of a curve. Those of a longer one are means over equal times.
const MAX_CURVE_POINTS: usize = 240;

/// A metric over the time of the fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Curve {
    name: &'static str,
    unit: &'static str,
    /// Whether its axis is logarithmic.
    logarithmic: bool,
    /// Seconds and values, in the order of time.
    points: Vec<(f64, f64)>,
}

/// The metrics of a run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Metrics {
    /// Curves with a point or more.
    pub(crate) curves: Vec<Curve>,
    /// The iterations of the run.
    pub(crate) iterations: u64,
    /// The wall time of these, in seconds.
    pub(crate) seconds: f64,
    /// A sentence about lines that cannot be read, or about their lack.
    pub(crate) warning: Option<String>,
}

/// A line of `metrics.jsonl`.
#[derive(Deserialize)]
struct Line {
    iteration: u64,
    seconds: f64,
    loss: f64,
    train_psnr: Option<f64>,
    psnr: Option<f64>,
}

/// Reads the file `metrics.jsonl`. Damaged lines are left out: with a warning, but for one at the
/// end, as a killed fit leaves it.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn metrics(path: &Path) -> Result<Metrics, InputError> {
    let bytes = files::read(path, "metrics", "the metrics of a run")?;
    let (whole, last) = bytes.split_at(bytes.iter().rposition(|b| *b == b'\n').unwrap_or(0));
    let all = || whole.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let read = |line| serde_json::from_slice::<Line>(line).ok();
    let damaged = all().filter(|line| read(line).is_none()).count();
    let mut lines: Vec<Line> = all().chain([last]).filter_map(read).collect();
    // A line repeats the last measurement of a held-out view until there is another one.
    let mut measured = None;
    for line in &mut lines {
        if line.psnr == measured {
            line.psnr = None;
        } else {
            measured = line.psnr;
        }
    }
    let warning = match (damaged, lines.len()) {
        (_, 0) => {
            Some("metrics.jsonl has no line that can be read: there are no curves".to_owned())
        }
        (0, _) => None,
        (n, m) => Some(format!("damaged lines of metrics.jsonl, left out: {n} of {}", n + m)),
    };
    let curve = |name, unit, logarithmic: bool, of: fn(&Line) -> Option<f64>| {
        let known = lines.iter().filter_map(|line| Some((line.seconds, of(line)?)));
        let known = known.filter(|(s, v)| s.is_finite() && v.is_finite());
        let points = thinned(known.filter(|(_, v)| !logarithmic || *v > 0.0).collect());
        Curve { name, unit, logarithmic, points }
    };
    let all = [
        curve("loss", "", true, |line| Some(line.loss)),
        curve("PSNR of training pixels", "dB", false, |line| line.train_psnr),
        curve("PSNR of previews (1 sample per pixel)", "dB", false, |line| line.psnr),
    ];
    let curves = all.into_iter().filter(|curve| !curve.points.is_empty()).collect();
    let last = lines.last().map_or((0, 0.0), |line| (line.iteration, line.seconds));
    Ok(Metrics { curves, iterations: last.0, seconds: last.1, warning })
}

/// The means over [`MAX_CURVE_POINTS`] equal times, if there are more points.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) else {
        return points;
    };
    if points.len() <= MAX_CURVE_POINTS || last.0 <= first.0 {
        return points;
    }
    let mut bins = vec![(0.0, 0.0, 0_usize); MAX_CURVE_POINTS];
    for (seconds, value) in points {
        let part = (seconds - first.0) / (last.0 - first.0);
        let bin = &mut bins[((part * MAX_CURVE_POINTS as f64) as usize).min(MAX_CURVE_POINTS - 1)];
        *bin = (bin.0 + seconds, bin.1 + value, bin.2 + 1);
    }
    let full = bins.into_iter().filter(|bin| bin.2 > 0);
    full.map(|(seconds, value, n)| (seconds / n as f64, value / n as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_curve_has_the_means_of_equal_times_and_damaged_lines_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = fit::RunFolder::new(folder.path()).metrics();
        let line = |i: u32| {
            let known = format!("{{\"iteration\":{i},\"seconds\":{i},\"loss\":{i}");
            known + ",\"train_psnr\":20.0,\"psnr\":null}\n"
        };
        let text: String = (0..4800).map(line).collect();
        std::fs::write(&path, text + "{\"seconds\":1").unwrap();
        let Metrics { curves, iterations, warning, .. } = metrics(&path).unwrap();
        assert_eq!((curves.len(), iterations, warning), (2, 4799, None));
        // A loss of 0 has no logarithm.
        assert_eq!(curves[0].points.len(), MAX_CURVE_POINTS);
        let (seconds, loss) = curves[0].points[0];
        assert!((seconds - loss).abs() < 1e-9 && (seconds - 10.5).abs() < 1.0);
        assert!(curves[1].points.iter().all(|p| (p.1 - 20.0).abs() < 1e-9));

        std::fs::write(&path, line(1) + "no line\n\n" + &line(2)).unwrap();
        let Metrics { curves, iterations, warning, .. } = metrics(&path).unwrap();
        assert_eq!((curves[0].points.len(), iterations), (2, 2));
        assert_eq!(warning.unwrap(), "damaged lines of metrics.jsonl, left out: 1 of 3");
        let measured = |i: u32, psnr: &str| line(i).replace("null", psnr);
        let text = ["20", "20", "21", "21"].map(|psnr| measured(1, psnr)).concat();
        std::fs::write(&path, text).unwrap();
        let Metrics { curves, .. } = metrics(&path).unwrap();
        assert_eq!((curves[1].points.len(), curves[2].points.len()), (4, 2), "repeated");

        std::fs::write(&path, "").unwrap();
        let Metrics { curves, warning, .. } = metrics(&path).unwrap();
        assert!(curves.is_empty() && warning.unwrap().contains("no line that can be read"));
    }
}
