//! The steps from photographs to poses, and the progress that COLMAP prints in each.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};

use serde::{Deserialize, Serialize};

/// A step of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Step {
    /// Finds places with texture in each photograph.
    Features,
    /// Finds the same places in pairs of photographs.
    Matching,
    /// Finds the poses, the lens and points of the scene.
    Mapping,
    /// Removes the distortion of the lens from the photographs.
    Undistortion,
}

impl Step {
    /// All steps, in their order.
    pub const ALL: [Step; 4] = [Step::Features, Step::Matching, Step::Mapping, Step::Undistortion];

    /// The name of the step, one word.
    pub fn name(self) -> &'static str {
        match self {
            Step::Features => "features",
            Step::Matching => "matching",
            Step::Mapping => "mapping",
            Step::Undistortion => "undistortion",
        }
    }

    /// The name of its results while it runs.
    pub(crate) fn partial(self) -> String {
        format!("{}.partial", self.name())
    }

    /// The fraction of the step that is done after this line of COLMAP's output, and its text;
    /// `None` for a line about something else. `photographs` is their number, and `before` that of
    /// calls of COLMAP before.
    pub(crate) fn progress(
        self,
        line: &str,
        photographs: usize,
        before: usize,
    ) -> Option<(f64, String)> {
        match self {
            Step::Features => {
                let [done, _] = numbers_after(line, "Processed file")?[..] else { return None };
                of_photographs(before + done, photographs)
            }
            Step::Undistortion => fraction_in(line, "Undistorting image"),
            Step::Matching => matched(line),
            Step::Mapping => registered(line, photographs),
        }
    }
}

impl Display for Step {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// The options that the result of a step depends on.
pub(crate) type Settings = BTreeMap<String, String>;

/// A step, and the options that it ran with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry {
    pub(crate) step: Step,
    pub(crate) settings: Settings,
}

/// The numbers of a line such as `Matching block [1/5, 2/5] in 3.1s`, after `start`.
fn numbers_after(line: &str, start: &str) -> Option<Vec<usize>> {
    // Newer versions print a time and a place in their source before the text.
    let (_, rest) = line.split_once(start)?;
    let (inside, _) = rest.trim_start().strip_prefix('[')?.split_once(']')?;
    inside.split([',', '/']).map(|word| word.trim().parse().ok()).collect()
}

/// The progress in a line such as `Undistorting image [3/48]`.
fn fraction_in(line: &str, start: &str) -> Option<(f64, String)> {
    let [done, all] = numbers_after(line, start)?[..] else { return None };
    of_photographs(done, all)
}

fn of_photographs(done: usize, all: usize) -> Option<(f64, String)> {
    (all > 0).then(|| (done as f64 / all as f64, format!("{done} of {all} photographs")))
}

/// The progress in a line of a matcher: of blocks of pairs, or of photographs.
fn matched(line: &str) -> Option<(f64, String)> {
    for start in ["Matching block", "Processing block"] {
        match numbers_after(line, start).as_deref() {
            Some(&[row, rows, column, columns]) if rows > 0 && columns > 0 && row > 0 => {
                let (done, all) = ((row - 1) * columns + column, rows * columns);
                return Some((done as f64 / all as f64, format!("block {done} of {all}")));
            }
            Some(&[done, all]) if all > 0 => {
                return Some((done as f64 / all as f64, format!("block {done} of {all}")));
            }
            _ => {}
        }
    }
    // COLMAP says no more until the vocabulary is done.
    if line.contains("Building index for visual words") {
        return Some((0.1, "a vocabulary of the features".to_owned()));
    }
    fraction_in(line, "Matching image").or_else(|| fraction_in(line, "Processing image"))
}

/// The progress in a line such as `Registering image #20 (3)`: the third photograph.
fn registered(line: &str, photographs: usize) -> Option<(f64, String)> {
    let (_, rest) = line.split_once("Registering image #")?;
    let (_, inside) = rest.split_once('(')?;
    let digits: String = inside.chars().filter(char::is_ascii_digit).collect();
    let done: usize = digits.parse().ok()?;
    let fraction = done as f64 / photographs.max(1) as f64;
    Some((fraction.min(1.0), format!("{done} of {photographs} photographs registered")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_old_and_new_versions_give_the_progress() {
        let text = |step: Step, line: &str| step.progress(line, 48, 0);
        let some = |fraction: f64, text: &str| Some((fraction, text.to_owned()));
        assert_eq!(
            text(Step::Features, "Processed file [12/48]"),
            some(0.25, "12 of 48 photographs")
        );
        let second = Step::Features.progress("Processed file [3/12]", 48, 36);
        assert_eq!(second, some(39.0 / 48.0, "39 of 48 photographs"));
        let new = "I20260901 10:00:00.0 1 feature_extraction.cc:254] Processed file [24/48]";
        assert_eq!(text(Step::Features, new), some(0.5, "24 of 48 photographs"));
        let block = some(0.7, "block 7 of 10");
        assert_eq!(text(Step::Matching, "Matching block [2/2, 2/5] in 2.5s"), block);
        assert_eq!(text(Step::Matching, "x.cc:1] Processing block [2/2, 2/5]"), block);
        assert_eq!(text(Step::Matching, "x.cc:1] Processing block [7/10]"), block);
        let image = some(0.5, "1 of 2 photographs");
        assert_eq!(text(Step::Matching, "Matching image [1/2] in 0.1s"), image);
        assert_eq!(text(Step::Matching, "x.cc:1] Processing image [1/2]"), image);
        let vocabulary = some(0.1, "a vocabulary of the features");
        assert_eq!(text(Step::Matching, "Building index for visual words..."), vocabulary);
        let mapped = some(0.25, "12 of 48 photographs registered");
        assert_eq!(text(Step::Mapping, "Registering image #20 (12)"), mapped);
        assert_eq!(text(Step::Mapping, "Registering image #20 (num_reg_frames=12)"), mapped);
        let undistorted = some(0.5, "1 of 2 photographs");
        assert_eq!(text(Step::Undistortion, "Undistorting image [1/2]"), undistorted);
    }

    #[test]
    fn other_lines_give_none() {
        for line in ["", "Matching block [", "Matching block [0/0, 0/0]", "Processed file [a/b]"] {
            for step in Step::ALL {
                assert_eq!(step.progress(line, 48, 0), None, "{line}");
            }
        }
        assert_eq!(Step::Matching.progress("Matching block [0/2, 1/2]", 4, 0), None);
        assert_eq!(Step::Mapping.progress("Registering image #2 (none)", 4, 0), None);
    }
}
