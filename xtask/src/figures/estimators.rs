//! Error against seconds, of every estimator on every scene of the gradient suite.

use std::fmt::Write;
use std::path::Path;

use measure::dsdf::{Case, gradient, scene, suite};
use measure::plot::{Curve, Panel, svg};
use measure::reference::{box_filtered, gaussian_filtered};

/// The estimators with whether they are of the Gaussian filter.
const ESTIMATORS: [(&str, bool); 8] = [
    ("interior", false),
    ("paper", false),
    ("paper-all", false),
    ("gaussian", true),
    ("was", true),
    ("loubet", true),
    ("band", false),
    ("refined", false),
];

/// Samples a pixel, until a run takes longer than the limit.
const SPP: [u32; 6] = [4, 16, 64, 256, 1024, 4096];
const LIMIT_SECONDS: f64 = 0.6;

/// The time at which the table compares, in seconds.
const AT: f64 = 0.3;

/// Runs of every cell; the error is the root of their mean square.
const SEEDS: u32 = 2;

/// Seconds and relative error of the runs of one estimator on one scene.
type Ladder = Vec<(f64, f64)>;

pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut csv = String::from("scene,wrt,estimator,spp,seed,seconds,evaluations,relative_l2\n");
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    for case in suite()? {
        eprintln!("{}", case.scene);
        let ladders = measure(binary, &case, &mut csv)?;
        rows.push(row(&case.scene, &ladders));
        let curve =
            |(name, points): (&(&str, bool), Ladder)| Curve { name: name.0.to_owned(), points };
        panels.push(Panel {
            title: case.scene,
            curves: ESTIMATORS.iter().zip(ladders).map(curve).collect(),
            front: false,
        });
        // What is measured is written at once.
        super::write(folder, "estimators.csv", &csv)?;
        super::write(folder, "estimators.svg", svg(&panels, "seconds", "relative L2 error"))?;
        super::write(folder, "estimators.md", table(&rows))?;
    }
    Ok(())
}

/// The ladder of every estimator on a case: the error is over all that the scene is differentiated
/// by.
fn measure(binary: &Path, case: &Case, csv: &mut String) -> anyhow::Result<Vec<Ladder>> {
    let scene = scene(&case.scene)?;
    let references =
        [box_filtered(binary, &scene, &case.wrt)?, gaussian_filtered(binary, &scene, &case.wrt)?];
    let mut ladders = Vec::new();
    for (name, filtered) in ESTIMATORS {
        let reference = &references[usize::from(filtered)];
        let mut ladder = Ladder::new();
        for spp in SPP {
            let (mut seconds, mut square) = (0.0, 0.0);
            for seed in 0..SEEDS {
                let flags =
                    ["--estimator", name, "--spp", &spp.to_string(), "--seed", &seed.to_string()]
                        .map(str::to_owned);
                let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
                let got = gradient(binary, &scene, &case.wrt, &flags)?;
                seconds += got.seconds / f64::from(SEEDS);
                for ((wrt, image), reference) in case.wrt.iter().zip(&got.images).zip(reference) {
                    let error = image.distance(reference) / reference.norm();
                    square += error * error / (f64::from(SEEDS) * case.wrt.len() as f64);
                    let _ = writeln!(
                        csv,
                        "{},{wrt},{name},{spp},{seed},{:.5},{},{error:.6}",
                        case.scene, got.seconds, got.evaluations
                    );
                }
            }
            ladder.push((seconds, square.sqrt()));
            if seconds > LIMIT_SECONDS {
                break;
            }
        }
        ladders.push(ladder);
    }
    Ok(ladders)
}

/// The error at a time, along the straight lines of a log–log plot; the nearest end outside.
fn error_at(ladder: &Ladder, seconds: f64) -> f64 {
    for pair in ladder.windows(2) {
        let [(t0, e0), (t1, e1)] = [pair[0], pair[1]];
        if seconds >= t0 && seconds <= t1 && t1 > t0 {
            let share = (seconds / t0).ln() / (t1 / t0).ln();
            return e0 * (e1 / e0).powf(share);
        }
    }
    let end = if ladder.first().is_some_and(|first| seconds < first.0) {
        ladder.first()
    } else {
        ladder.last()
    };
    end.map_or(f64::NAN, |end| end.1)
}

/// The errors of a scene at equal time.
fn row(scene: &str, ladders: &[Ladder]) -> (String, Vec<f64>) {
    (scene.to_owned(), ladders.iter().map(|ladder| error_at(ladder, AT)).collect())
}

fn table(rows: &[(String, Vec<f64>)]) -> String {
    let mut out = format!(
        "Relative L2 error of derivative images after {AT} s, root mean square over {SEEDS} seeds and all parameters.\n\n| scene |"
    );
    ESTIMATORS.iter().for_each(|(name, _)| out += &format!(" {name} |"));
    out += " next best over `refined` |\n|---|";
    ESTIMATORS.iter().for_each(|_| out += "---|");
    out += "---|\n";
    for (scene, errors) in rows {
        let _ = write!(out, "| {scene} |");
        errors.iter().for_each(|e| out += &format!(" {e:.4} |"));
        let (ours, others) = (errors[errors.len() - 1], &errors[..errors.len() - 1]);
        let best = others.iter().copied().fold(f64::MAX, f64::min);
        let _ = writeln!(out, " {:.1} × |", best / ours);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_read_off_straight_lines() {
        let ladder = vec![(0.01, 1.0), (1.0, 0.01)];
        assert!((error_at(&ladder, 0.1) - 0.1).abs() < 1e-12);
        assert_eq!(error_at(&ladder, 5.0), 0.01);
        assert_eq!(error_at(&ladder, 0.001), 1.0);
    }
}
