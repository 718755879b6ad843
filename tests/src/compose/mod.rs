//! Variants of a data set of renders: the same object before other backgrounds.
//!
//! A render with a mask is taken apart: the object's light in a pixel is the pixel less the part of
//! the render's own background that the object leaves uncovered. The variant is the object's light
//! plus the uncovered part of another background, in linear light:
//!
//! ```text
//! object = I − (1 − coverage) · own background
//! I'     = object + (1 − coverage) · new background
//! ```

mod backdrop;
mod kind;
mod output;
mod source;
mod texture;

use std::path::Path;

use files::WriteError;

pub use kind::Kind;

use backdrop::Backdrop;
use source::Source;

/// Writes a variant of the data set `source` into `output`, as a NeRF/Blender data set.
///
/// Training views and held-out views get the same treatment. The files are:
/// - `train/r_000.png` and so on, `test/…` for held-out views: 8-bit sRGB;
/// - `masks/train/r_000.png` and so on: the coverage of the source. [`Kind::Alpha`] has none;
/// - `transforms_train.json`, and `transforms_test.json` if views are held out;
/// - `compose.json`: the kind, the seed, and for each view the random colour (linear RGB) or the
///   exposure (stops);
/// - a copy of each mesh that lies in the folder of the source.
///
/// The same source, kind and seed give the same files. `progress` receives the fraction done.
///
/// # Errors
/// [`WriteError::Input`] if the source is no data set, if a view has no mask, if the uncovered
/// pixels of the source differ in colour, or if `output` is not a new or empty folder. Other errors
/// if a file cannot be written.
pub fn compose(
    kind: Kind,
    source: &Path,
    output: &Path,
    seed: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<(), WriteError> {
    output::check_empty(output)?;
    let source = Source::load(source)?;
    let backdrop = Backdrop::new(kind, seed);
    let total = (source.dataset.train.len() + source.dataset.test.len()) as f64;
    let mut records = Vec::new();
    for (set, (name, views)) in source.sets().into_iter().enumerate() {
        output::create_folders(output, name, kind)?;
        for (i, view) in views.iter().enumerate() {
            let layers = source.layers(view);
            let setting = backdrop.setting(set, i);
            let file = format!("{name}/r_{i:03}.png");
            if kind == Kind::Alpha {
                output::write_straight_alpha(&output.join(&file), &layers)?;
            } else {
                let image = backdrop.photograph(&setting, &view.camera, &layers);
                film::write_image(&output.join(&file), &image)?;
                output::write_mask(&output.join("masks").join(&file), &layers)?;
            }
            records.push(setting.record(&file));
            progress(records.len() as f64 / total);
        }
        output::write_transforms(output, name, views)?;
    }
    output::write_record(output, kind, seed, records)?;
    output::copy_meshes(&source.folder, output)
}
