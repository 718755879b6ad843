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

/// The names of a mask of the photograph `STEM.png` in `FOLDER`.
const MASKS: [&str; 7] = [
    "masks/STEM.png",
    "Mask/STEM.png.png",
    "FOLDER/STEM_mask.png",
    "FOLDER/STEM.mask.png",
    "FOLDER/dynamic_mask_STEM.png",
    "masks/FOLDER/STEM.png",
    "masks/other.png",
];

/// The file of a mask of a photograph: a harmed one, or one of another size.
fn mask() -> impl Strategy<Value = (&'static str, Vec<u8>)> {
    let sides = prop::sample::select(vec![SIZE, 2 * SIZE, SIZE + 1]);
    let whole = sides.prop_map(|side| photograph([side; 2], false));
    (prop::sample::select(MASKS.to_vec()), prop_oneof![whole, png_bytes()])
}

/// Adds the photographs `NAME.png` of a folder; one in ten sets has a harmed one, and one in four a
/// mask.
pub(super) fn with_photographs(
    cases: impl Strategy<Value = (Case, Vec<String>)> + 'static,
) -> BoxedStrategy<Case> {
    let harmed = prop_oneof![9 => Just(None), 1 => (0..9usize, png_bytes()).prop_map(Some)];
    let mask = prop_oneof![3 => Just(None), 1 => mask().prop_map(Some)];
    (cases, any::<bool>(), harmed, mask)
        .prop_map(|((mut case, names), alpha, harmed, mask)| {
            let count = names.len();
            if let (Some((pattern, bytes)), Some(name)) = (mask, names.first()) {
                let (folder, file) = name.rsplit_once('/').unwrap_or((".", name));
                let stem = file.trim_end_matches(".png");
                case = case.file(pattern.replace("FOLDER", folder).replace("STEM", stem), bytes);
            }
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
