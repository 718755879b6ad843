//! The cameras and the photographs of data sets of all formats.

use proptest::prelude::*;

use crate::case::Case;
use crate::formats::images::{photograph, png_bytes};

/// Width and height of a photograph, in pixels.
pub(super) const SIZE: u32 = 8;

/// The focal length, in pixels.
pub(super) const FOCAL: f64 = 16.0;

/// The distance of every camera from the origin.
const DISTANCE: f64 = 3.0;

/// Right, down and forward of camera `i`, which circles the y axis and looks at it.
pub(super) fn axes(i: usize) -> [[f64; 3]; 3] {
    let (sin, cos) = (i as f64 * 0.9).sin_cos();
    [[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]]
}

pub(super) fn eye(i: usize) -> [f64; 3] {
    axes(i)[2].map(|v| -DISTANCE * v)
}

/// The translation of the world-to-camera pose: the origin is on every camera's axis.
pub(super) const TRANSLATION: [f64; 3] = [0.0, 0.0, DISTANCE];

/// Adds the photographs `NAME.png` of a folder; one in ten sets has a harmed one.
pub(super) fn with_photographs(
    cases: impl Strategy<Value = (Case, Vec<String>)> + 'static,
) -> BoxedStrategy<Case> {
    let harmed = prop_oneof![9 => Just(None), 1 => (0..9usize, png_bytes()).prop_map(Some)];
    (cases, any::<bool>(), harmed)
        .prop_map(|((mut case, names), alpha, harmed)| {
            let count = names.len();
            for (i, name) in names.into_iter().enumerate() {
                let bytes = match &harmed {
                    Some((which, bytes)) if which % count == i => bytes.clone(),
                    _ => photograph([SIZE; 2], alpha),
                };
                case = case.file(name, bytes);
            }
            case
        })
        .boxed()
}

/// Numbers with a blank between.
pub(super) fn words(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}
