//! Writing of a data set in two forms that other programs read: nerfstudio's `transforms.json`, and a
//! COLMAP model as text (their documentation: "Data conventions"; "Output Format").

use std::fmt::Write as _;
use std::fs;
use std::path::{Component, Path};

use files::{InputError, WriteError, atomic_write};
use film::write_image;
use glam::{DMat3, DQuat, DVec2};
use render::Camera;
use serde_json::{Value, json};

use crate::{Dataset, View};

/// The most positions along the half diagonal of a film at which a lens is converted.
const LENS_SAMPLES: usize = 256;

/// Writes a data set into `folder`, which is new or empty: `images/*.png` (8-bit sRGB), the cameras in
/// `transforms.json` (nerfstudio, with the held-out views as `test_filenames`) and in `sparse/0`
/// (COLMAP, text), and the points on surfaces in `sparse/0`, without tracks.
///
/// Positions are those of the data set; see [`Dataset`]. A radial distortion of cameras is converted
/// to the model `OPENCV` of both forms. Returns the largest error of this conversion, in pixels: 0 for
/// pinholes. `progress` gets the fraction done.
///
/// # Errors
/// If the folder has files, or a file cannot be written.
pub fn write(
    folder: &Path,
    dataset: &Dataset,
    progress: &mut dyn FnMut(f64),
) -> Result<f64, WriteError> {
    check_empty(folder)?;
    let (images, model) = (folder.join("images"), folder.join("sparse/0"));
    for own in [&images, &model] {
        fs::create_dir_all(own).map_err(|error| WriteError::of_folder(own, error))?;
    }
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let names = names(&views);
    for (i, (view, name)) in views.iter().zip(&names).enumerate() {
        write_image(&images.join(name), &view.image)?;
        progress((i + 1) as f64 / views.len() as f64);
    }
    let lenses: Vec<Lens> = views.iter().map(|view| Lens::of(&view.camera)).collect();
    let files = [
        ("sparse/0/cameras.txt", cameras(&views, &lenses)),
        ("sparse/0/images.txt", poses(&views, &names)),
        ("sparse/0/points3D.txt", points(dataset)),
        // The last one: with it, the data set is whole.
        ("transforms.json", transforms(dataset, &names, &lenses).to_string()),
    ];
    for (name, text) in files {
        atomic_write(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(lenses.iter().map(|lens| lens.error).fold(0.0, f64::max))
}

/// Checks that a data set can be written into `folder`.
///
/// # Errors
/// If it has files, is no folder, or accepts no files.
pub fn check_empty(folder: &Path) -> Result<(), WriteError> {
    files::check_output_folder(folder)?;
    let first = fs::read_dir(folder).into_iter().flatten().flatten().next();
    match first {
        None => Ok(()),
        Some(entry) => {
            let found = format!("a folder with files ({})", entry.file_name().to_string_lossy());
            Err(InputError::new(folder, "output", found, "a new or an empty folder").into())
        }
    }
}

/// The names of the images in one folder: those of the views, with `_` in the place of separators,
/// and a number where two would be the same.
fn names(views: &[&View]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for view in views {
        let path = Path::new(&view.name).with_extension("");
        let parts = path.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        });
        // COLMAP separates the fields of a line by spaces.
        let base: String = parts.collect::<Vec<_>>().join("_").replace(char::is_whitespace, "_");
        let candidates = (1..).map(|n| match n {
            1 => format!("{base}.png"),
            _ => format!("{base}-{n}.png"),
        });
        let lower = |name: &String| name.to_lowercase();
        let taken: Vec<String> = names.iter().map(lower).collect();
        names.extend(candidates.into_iter().find(|name| !taken.contains(&lower(name))));
    }
    names
}

/// The distortion of a camera in the model `OPENCV`, which maps the tangents of a point to those at
/// which the photograph shows it: [`Camera::radial`] is the map backwards.
#[derive(Clone, Copy, Debug, Default)]
struct Lens {
    k1: f64,
    k2: f64,
    /// The largest error on the film, in pixels.
    error: f64,
}

impl Lens {
    /// By least squares over the distances from the principal point.
    fn of(camera: &Camera) -> Self {
        if camera.radial == DVec2::ZERO {
            return Lens::default();
        }
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let far = camera.principal.max(size - camera.principal) / camera.focal;
        let steps = 1..=LENS_SAMPLES;
        let shown = steps.map(|i| far.length() * i as f64 / LENS_SAMPLES as f64);
        // Pairs of the tangent of a point and that at which the photograph shows it.
        let factor = |p: f64| 1.0 + p * p * (camera.radial.x + p * p * camera.radial.y);
        let pairs: Vec<(f64, f64)> = shown.map(|p| (p * factor(p), p)).collect();
        // shown - q = k1 q³ + k2 q⁵
        let mut sums = [0.0; 5];
        for (q, p) in &pairs {
            let (a, b, rest) = (q.powi(3), q.powi(5), p - q);
            for (sum, term) in sums.iter_mut().zip([a * a, a * b, b * b, a * rest, b * rest]) {
                *sum += term;
            }
        }
        let [aa, ab, bb, ar, br] = sums;
        let determinant = aa * bb - ab * ab;
        let [k1, k2] = [(ar * bb - br * ab) / determinant, (br * aa - ar * ab) / determinant];
        let off = |(q, p): &(f64, f64)| (q + k1 * q.powi(3) + k2 * q.powi(5) - p).abs();
        let worst = pairs.iter().map(off).fold(0.0, f64::max);
        Lens { k1, k2, error: worst * camera.focal.max_element() }
    }
}

/// The content of `transforms.json`.
fn transforms(dataset: &Dataset, names: &[String], lenses: &[Lens]) -> Value {
    let file = |name: &String| format!("images/{name}");
    let views = dataset.train.iter().chain(&dataset.test);
    let frame = |((view, name), lens): ((&View, &String), &Lens)| {
        let Camera { width, height, focal, principal, .. } = view.camera;
        json!({
            "file_path": file(name),
            "transform_matrix": view.camera.pose().transpose().to_cols_array_2d(),
            "w": width, "h": height, "fl_x": focal.x, "fl_y": focal.y,
            "cx": principal.x, "cy": principal.y,
            "k1": lens.k1, "k2": lens.k2, "p1": 0.0, "p2": 0.0
        })
    };
    let frames: Vec<Value> = views.zip(names).zip(lenses).map(frame).collect();
    let mut content = json!({"camera_model": "OPENCV", "frames": frames});
    let (train, test) = names.split_at(dataset.train.len());
    if !test.is_empty() {
        let all = |names: &[String]| names.iter().map(file).collect::<Vec<_>>();
        (content["train_filenames"], content["test_filenames"]) =
            (json!(all(train)), json!(all(test)));
        content["val_filenames"] = content["test_filenames"].clone();
    }
    content
}

/// The content of `cameras.txt`: a camera for each view, with its number.
fn cameras(views: &[&View], lenses: &[Lens]) -> String {
    let mut text = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, fx, fy, cx, cy, k1, k2, p1, p2\n".to_owned();
    for (i, (view, lens)) in views.iter().zip(lenses).enumerate() {
        let Camera { width, height, focal, principal, .. } = view.camera;
        let (id, f, c) = (i + 1, focal, principal);
        let _ = writeln!(
            text,
            "{id} OPENCV {width} {height} {} {} {} {} {} {} 0 0",
            f.x, f.y, c.x, c.y, lens.k1, lens.k2
        );
    }
    text
}

/// The content of `images.txt`: world to camera, x right, y down, z forward. The line of the
/// keypoints of a view is empty.
fn poses(views: &[&View], names: &[String]) -> String {
    let mut text = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n".to_owned();
    for (i, (view, name)) in views.iter().zip(names).enumerate() {
        let Camera { eye, right, up, forward, .. } = view.camera;
        let to_camera = DMat3::from_cols(right, -up, forward).transpose();
        let (q, t) = (DQuat::from_mat3(&to_camera).normalize(), -(to_camera * eye));
        let id = i + 1;
        let _ = writeln!(
            text,
            "{id} {} {} {} {} {} {} {} {id} {name}\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z
        );
    }
    text
}

/// The content of `points3D.txt`: grey points, without tracks.
fn points(dataset: &Dataset) -> String {
    let mut text = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n".to_owned();
    for (i, point) in dataset.points.iter().enumerate() {
        let _ = writeln!(text, "{} {} {} {} 128 128 128 0", i + 1, point.x, point.y, point.z);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LoadOptions, load};
    use film::Film;
    use glam::DVec3;

    fn view(name: &str, i: u32, radial: DVec2) -> View {
        let eye = DVec3::new(2.0 + f64::from(i), -0.7, 1.3);
        let (focal, principal) = (DVec2::new(31.0, 30.0), DVec2::new(12.3, 8.9));
        let (target, up) = (DVec3::new(0.1, 0.2, 0.0), DVec3::Z);
        let camera = Camera::look_at(24, 18, focal, principal, eye, target, up).unwrap();
        let mut image = Film::new(24, 18);
        image.pixels.iter_mut().enumerate().for_each(|(k, p)| *p = [k as f32 / 500.0, 0.25, 1.0]);
        let camera = Camera { radial, ..camera };
        View { name: name.to_owned(), path: "x".into(), camera, image, mask: None }
    }

    fn dataset(radial: DVec2) -> Dataset {
        let train = ["a/one.jpg", "a_one.png", "../b c.png"].into_iter().zip(0..);
        Dataset {
            path: "x".into(),
            format: String::new(),
            train: train.map(|(name, i)| view(name, i, radial)).collect(),
            test: vec![view("held.png", 7, radial)],
            bounds: None,
            points: vec![DVec3::new(0.1, 0.2, 0.3), DVec3::new(-4.0, 5.0, 6.5)],
            is_sure: Vec::new(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn both_forms_read_as_the_data_set() {
        let folder = tempfile::tempdir().unwrap();
        let (data, out) = (dataset(DVec2::ZERO), folder.path().join("out"));
        let mut done = 0.0;
        assert_eq!(write(&out, &data, &mut |p| done = p).unwrap(), 0.0);
        assert_eq!(done, 1.0);
        let options = LoadOptions::default();
        let nerfstudio = load(&out.join("transforms.json"), &options).unwrap();
        assert_eq!((nerfstudio.train.len(), nerfstudio.test.len()), (3, 1));
        let colmap = load(&out.join("sparse/0"), &options).unwrap();
        assert_eq!(colmap.points, data.points);
        for own in data.train.iter().chain(&data.test) {
            for read in [&nerfstudio, &colmap] {
                let views = read.train.iter().chain(&read.test);
                let same = |view: &&View| (view.camera.eye - own.camera.eye).length() < 1e-9;
                let found = views.into_iter().find(same).unwrap();
                for u in [DVec2::ZERO, DVec2::new(20.0, 3.0)] {
                    let off = found.camera.direction(u) - own.camera.direction(u);
                    assert!(off.length() < 1e-9, "{off}");
                }
                let difference = |(a, b): (&[f32; 3], &[f32; 3])| (a[0] - b[0]).abs();
                let pixels = found.image.pixels.iter().zip(&own.image.pixels);
                assert!(pixels.map(difference).fold(0.0, f32::max) < 0.01);
            }
        }
        let error = write(&out, &data, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains("output: found a folder with files"), "{error}");
    }

    #[test]
    fn a_lens_of_a_fit_becomes_one_of_other_programs() {
        let radial = DVec2::new(-0.08, 0.03);
        let camera = view("a", 0, radial).camera;
        let lens = Lens::of(&camera);
        assert!(lens.k1 > 0.05 && lens.error < 0.02, "{lens:?}");
        // A point in space is shown where the other lens shows it.
        for x in [DVec3::new(0.3, 0.4, 0.2), DVec3::new(-0.4, 0.1, -0.2)] {
            let pinhole = Camera { radial: DVec2::ZERO, ..camera };
            let q = (pinhole.project(x).unwrap() - camera.principal) / camera.focal;
            let square = q.length_squared();
            let shown = q * (1.0 + square * (lens.k1 + square * lens.k2));
            let u = camera.principal + shown * camera.focal;
            assert!((u - camera.project(x).unwrap()).length() < 0.02);
        }
    }
}
