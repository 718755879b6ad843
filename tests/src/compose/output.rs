//! The files of a variant.

use std::io::{self, Cursor};
use std::path::Path;

use dataset::View;
use files::{InputError, WriteError, atomic_write, check_output_folder};
use film::write_image;
use film::{Film, srgb_decode, srgb_encode};
use image::{ImageFormat, RgbaImage};
use serde_json::{Value, json};

use super::kind::Kind;
use super::source::Layers;

/// The extensions of mesh files.
const MESHES: [&str; 3] = ["ply", "obj", "glb"];

/// Refuses a folder that has files: those of another variant would mix with the new ones.
pub(super) fn check_empty(folder: &Path) -> Result<(), WriteError> {
    let has_files = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if has_files || folder.is_file() {
        let found = if has_files { "a folder with files" } else { "a file" };
        return Err(InputError::new(folder, "output", found, "a new or empty folder").into());
    }
    check_output_folder(folder)
}

/// Creates the folders for the images and the masks of a set.
pub(super) fn create_folders(folder: &Path, set: &str, kind: Kind) -> Result<(), InputError> {
    let masks = (kind != Kind::Alpha).then(|| folder.join("masks").join(set));
    for folder in [Some(folder.join(set)), masks].into_iter().flatten() {
        std::fs::create_dir_all(&folder)
            .map_err(|e| InputError::new(&folder, "output", e, "a folder that can be written"))?;
    }
    Ok(())
}

/// Writes the coverage as a grey picture.
pub(super) fn write_mask(path: &Path, layers: &Layers) -> Result<(), WriteError> {
    // A mask file holds coverage as display values; `write_image` encodes linear ones.
    let linear = layers.coverage.iter().map(|a| srgb_decode(*a));
    write_image(path, &Film::grey(layers.width, layers.height, linear))
}

/// Writes the object with its coverage as the alpha channel, not multiplied into the colours.
pub(super) fn write_straight_alpha(path: &Path, layers: &Layers) -> Result<(), WriteError> {
    let byte = |display: f32| (display.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixel = |(object, a): (&[f32; 3], &f32)| match byte(*a) {
        0 => [0; 4],
        // Divided by the alpha of the file, so that the product is the object's light.
        alpha => {
            let color = object.map(|c| byte(srgb_encode(255.0 * c / f32::from(alpha))));
            [color[0], color[1], color[2], alpha]
        }
    };
    let bytes = layers.object.iter().zip(&layers.coverage).flat_map(pixel).collect();
    atomic_write(path, |out| {
        let image = RgbaImage::from_raw(layers.width, layers.height, bytes)
            .ok_or_else(|| io::Error::other("fewer pixels than the size has"))?;
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::Png).map_err(io::Error::other)?;
        out.write_all(file.get_ref())
    })
}

/// Writes `transforms_SET.json`: the poses and intrinsics of all views. Those at the top of the
/// file, for programs that know no others, are of the first view.
pub(super) fn write_transforms(folder: &Path, set: &str, views: &[View]) -> Result<(), WriteError> {
    let intrinsics = |view: &View| {
        let camera = &view.camera;
        json!({
            "camera_angle_x": 2.0 * (0.5 * f64::from(camera.width) / camera.focal.x).atan(),
            "w": camera.width, "h": camera.height,
            "fl_x": camera.focal.x, "fl_y": camera.focal.y,
            "cx": camera.principal.x, "cy": camera.principal.y
        })
    };
    let frame = |(i, view): (usize, &View)| {
        let mut frame = intrinsics(view);
        frame["file_path"] = format!("./{set}/r_{i:03}").into();
        frame["transform_matrix"] = json!(view.camera.pose().transpose().to_cols_array_2d());
        frame
    };
    let mut root = intrinsics(&views[0]);
    root["frames"] = views.iter().enumerate().map(frame).collect();
    write_json(&folder.join(format!("transforms_{set}.json")), &root)
}

/// Writes `compose.json`: the origin of the data set.
pub(super) fn write_record(
    folder: &Path,
    kind: Kind,
    seed: u64,
    views: Vec<Value>,
) -> Result<(), WriteError> {
    let record = json!({"kind": kind.name(), "seed": seed, "views": views});
    write_json(&folder.join("compose.json"), &record)
}

fn write_json(path: &Path, value: &Value) -> Result<(), WriteError> {
    atomic_write(path, |out| out.write_all(&serde_json::to_vec_pretty(value)?))
}

/// Copies the meshes that lie in the folder `from` itself.
pub(super) fn copy_meshes(from: &Path, to: &Path) -> Result<(), WriteError> {
    let from = if from.as_os_str().is_empty() { Path::new(".") } else { from };
    // The views were read from this folder: it can be listed.
    for entry in std::fs::read_dir(from).into_iter().flatten().flatten() {
        let path = entry.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if let Some(name) = path.file_name().filter(|_| MESHES.contains(&extension)) {
            let bytes = files::read(&path, "mesh", "a readable file")?;
            atomic_write(&to.join(name), |out| out.write_all(&bytes))?;
        }
    }
    Ok(())
}
