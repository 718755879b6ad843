//! What to expect of a fit: the time and the distance to the surface, from fits that were measured.

use fit::{Budget, FitOptions};

/// Times and distances of fits at the defaults, which `cargo xtask record fits` measures.
const MEASURED: &str = include_str!("expected.csv");

/// A measured fit.
struct Measured<'a> {
    set: &'a str,
    /// Whether the background was trained, as in a room.
    is_trained: bool,
    iterations: f64,
    /// On one core.
    seconds: f64,
    /// In radii of the object.
    distance: f64,
}

impl<'a> Measured<'a> {
    fn of_line(line: &'a str) -> Option<Self> {
        let mut cells = line.split(',').rev();
        let mut number = || cells.next()?.parse::<f64>().ok();
        let (distance, seconds, iterations) = (number()?, number()?, number()?);
        let (set, kind) = (cells.next()?, cells.next_back()?);
        Some(Measured { set, is_trained: kind != "studio", iterations, seconds, distance })
    }
}

/// One line about the time and the distance to expect on this number of threads. `None` if nothing
/// like this fit was measured: its network or its estimator is not the default, or it is far longer or
/// shorter.
pub(super) fn expected(options: &FitOptions, is_trained: bool, threads: usize) -> Option<String> {
    let default = FitOptions::default();
    let is_default = options.width == default.width
        && options.layers == default.layers
        && options.grid == default.grid
        && options.estimator == default.estimator;
    if !is_default {
        return None;
    }
    let all: Vec<Measured<'_>> = MEASURED.lines().filter_map(Measured::of_line).collect();
    let own: Vec<&Measured<'_>> = all.iter().filter(|fit| fit.is_trained == is_trained).collect();
    // Threads make a fit faster by about the root of their number; docs/iteration.md has it.
    let speed = (threads.min(MOST_THREADS) as f64).sqrt();
    let [fast, slow] = range(own.iter().map(|fit| fit.seconds / fit.iterations / speed))?;
    let (iterations, time) = match options.budget() {
        Budget::Iterations(n) => {
            let n = n as f64;
            (n, format!("{} to {}", duration(n * fast), duration(n * slow)))
        }
        Budget::Time(time) => {
            let seconds = time.as_secs_f64();
            (seconds / (fast * slow).sqrt(), duration(seconds))
        }
    };
    let found: Vec<f64> = sets(&own).filter_map(|set| at(&own, set, iterations)).collect();
    let [near, far] = range(found.iter().copied())?;
    let threads = if threads == 1 { "one thread".to_owned() } else { format!("{threads} threads") };
    let (count, like) = (found.len(), if is_trained { ROOMS } else { STUDIO });
    Some(format!(
        "expected: a distance to the surface of {:.2} to {:.2} % of the radius after {time} on \
         {threads}, as measured on {count} {like}; few, blurred or badly posed photographs give more",
        100.0 * near,
        100.0 * far
    ))
}

/// The data sets of the measured fits.
const STUDIO: &str = "objects in front of one colour";
const ROOMS: &str = "objects in rooms";

/// The most threads that make a fit faster.
const MOST_THREADS: usize = 16;

/// A data set counts from its smallest measured number of iterations over this on, and up to this many
/// times the largest.
const BEYOND: f64 = 2.0;

/// The names of the data sets, each once.
fn sets<'a>(own: &[&Measured<'a>]) -> impl Iterator<Item = &'a str> {
    let mut names: Vec<&str> = own.iter().map(|fit| fit.set).collect();
    names.dedup();
    names.into_iter()
}

/// The distance of a data set after this number of iterations, along straight lines of the logarithms.
/// From a half of the smallest measured number on, and up to twice the largest, it is that of the nearest
/// one; beyond, none.
fn at(own: &[&Measured<'_>], set: &str, iterations: f64) -> Option<f64> {
    let mut fits = own.iter().filter(|fit| fit.set == set);
    let mut before = fits.next()?;
    if iterations <= before.iterations {
        return (iterations * BEYOND >= before.iterations).then_some(before.distance);
    }
    for fit in fits {
        if iterations <= fit.iterations {
            let share =
                (iterations / before.iterations).ln() / (fit.iterations / before.iterations).ln();
            return Some(before.distance * (fit.distance / before.distance).powf(share));
        }
        before = fit;
    }
    (iterations <= BEYOND * before.iterations).then_some(before.distance)
}

/// The smallest and the largest number.
fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.fold(None, |range, v| match range {
        None => Some([v, v]),
        Some([low, high]) => Some([v.min(low), v.max(high)]),
    })
}

/// A time with two digits.
fn duration(seconds: f64) -> String {
    if seconds < 90.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_interpolated_between_measured_fits() {
        let fit = |iterations, distance| Measured {
            set: "a",
            is_trained: false,
            iterations,
            seconds: iterations / 100.0,
            distance,
        };
        let all = [fit(1000.0, 0.01), fit(4000.0, 0.0025)];
        let own: Vec<&Measured<'_>> = all.iter().collect();
        let found = [500.0, 1000.0, 2000.0, 7000.0].map(|n| at(&own, "a", n).unwrap());
        for (found, expected) in found.into_iter().zip([0.01, 0.01, 0.005, 0.0025]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let none = [("a", 9000.0), ("a", 400.0), ("b", 1000.0)];
        assert!(none.into_iter().all(|(set, n)| at(&own, set, n).is_none()));
    }

    #[test]
    fn every_line_of_the_measured_fits_is_one() {
        let lines = MEASURED.lines().skip(1);
        let count = lines.clone().count();
        assert!(count > 4);
        assert_eq!(lines.filter_map(Measured::of_line).count(), count);
    }

    #[test]
    fn longer_fits_are_expected_to_be_nearer_and_other_networks_are_unknown() {
        let line = |iterations| {
            let options = FitOptions { iterations: Some(iterations), ..FitOptions::default() };
            expected(&options, false, 2).unwrap()
        };
        assert!(
            line(2000).starts_with("expected: a distance to the surface of 0."),
            "{}",
            line(2000)
        );
        assert_ne!(line(1000), line(18_000));
        let other = FitOptions { width: 96, ..FitOptions::default() };
        assert_eq!(expected(&other, false, 2), None);
        let short = FitOptions { iterations: Some(300), ..FitOptions::default() };
        assert_eq!(expected(&short, false, 2), None);
    }
}
