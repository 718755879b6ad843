//! Data sets: NeRF, nerfstudio, NeuS, IDR, Middlebury and COLMAP, each with tiny photographs.

use std::fmt::Write;

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::case::Case;
use crate::formats::arrays::{Array, archives};
use crate::formats::images::photograph;
use crate::formats::views::{FOCAL, SIZE, TRANSLATION, axes, eye, with_photographs, words};
use crate::formats::{forms, meshes};
use crate::layout::Layout;
use crate::lines::Lines;
use crate::spoil::{sometimes_spoiled, spoiled};
use crate::tree::Tree;

/// The name of image `i` of a NeRF data set.
fn image_name(i: usize) -> String {
    format!("images/{i:03}.png")
}

fn transforms(frames: usize, intrinsics: usize, extras: usize) -> Tree {
    let frame = |i: usize| {
        let ([right, down, forward], at) = (axes(i), eye(i));
        let row = |r: usize| json!([right[r], -down[r], -forward[r], at[r]]);
        json!({"file_path": image_name(i),
               "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]]})
    };
    let mut root = json!({"frames": (0..frames).map(frame).collect::<Vec<_>>()});
    let mut put = |key: &str, value: Value| root[key] = value;
    match intrinsics {
        0 => put("camera_angle_x", json!(0.49)),
        1 => {
            put("fl_x", json!(FOCAL));
            put("fl_y", json!(FOCAL));
            put("cx", json!(4));
            put("cy", json!(4));
        }
        _ => {
            put("fl_x", json!(FOCAL));
            put("w", json!(SIZE));
            put("h", json!(SIZE));
        }
    }
    match extras {
        0 => {
            put("camera_model", json!("OPENCV"));
            for (key, value) in [("k1", 0.1), ("k2", -0.01), ("p1", 0.001), ("p2", 0.0)] {
                put(key, json!(value));
            }
        }
        1 => root["frames"][0]["mask_path"] = json!("images/000.png"),
        2 => put("aabb_scale", json!(16)),
        3 => {
            put("camera_model", json!("OPENCV_FISHEYE"));
            for (key, value) in [("k1", 0.1), ("k2", -0.01), ("k3", 0.001), ("k4", 0.0)] {
                put(key, json!(value));
            }
        }
        4 => {
            for key in ["k1", "k2", "k3", "k4", "k5", "k6"] {
                put(key, json!(0.01));
            }
            put("applied_transform", json!([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 5]]));
            put("applied_scale", json!(0.5));
        }
        5 => {
            put("ply_file_path", json!("points.ply"));
            put("train_filenames", json!(["images/000.png"]));
            put("val_filenames", json!((1..frames).map(image_name).collect::<Vec<_>>()));
        }
        6 => {
            put("from_na", json!(true));
            put("intrinsic_matrix", json!([[FOCAL, 0, 4], [0, FOCAL, 4], [0, 0, 1]]));
            put("sphere_center", json!([0, 0, 0]));
            put("sphere_radius", json!(1));
        }
        7 => root["frames"][0]["transform_matrix"] = Value::Null,
        _ => {}
    }
    root.into()
}

/// A folder of a NeRF data set.
pub(crate) fn nerf() -> BoxedStrategy<Case> {
    let roots = (1..5usize, 0..3usize, 0..10usize);
    let roots = roots.prop_flat_map(|(frames, intrinsics, extras)| {
        let root = spoiled(Just(transforms(frames, intrinsics, extras)));
        (root, Just(frames), any::<bool>(), meshes::point_clouds())
    });
    with_photographs(roots.prop_map(|(root, frames, split, points)| {
        let names = (0..frames).map(image_name).collect();
        let case = Case::default().file("points.ply", points);
        let case = if split {
            case.file("transforms_train.json", root.json())
                .file("transforms_test.json", transforms(1, 0, 99).json())
        } else {
            case.file("transforms.json", root.json())
        };
        (case, names)
    }))
}

/// A folder of a NeuS data set.
pub(crate) fn neus() -> BoxedStrategy<Case> {
    let archive = |views: usize| {
        let matrices = (0..views).flat_map(|i| {
            let ([right, down, forward], t) = (axes(i), TRANSLATION);
            let row = |axis: [f64; 3], t: f64| [axis[0], axis[1], axis[2], t];
            let z = row(forward, t[2]);
            let centre = f64::from(SIZE) / 2.0 - 0.5;
            let image = |axis: [f64; 3], t: f64| {
                let r = row(axis, t);
                std::array::from_fn(|j| FOCAL * r[j] + centre * z[j])
            };
            let last = [0.0, 0.0, 0.0, 1.0];
            let world = [image(right, t[0]), image(down, t[1]), z, last];
            let scale = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(r == c)));
            [(format!("world_mat_{i}"), world), (format!("scale_mat_{i}"), scale)]
        });
        archives(matrices.map(|(name, rows)| (name, Array::matrix(rows))).collect())
    };
    let folders =
        (1..4usize).prop_flat_map(move |views| (Just(views), archive(views), 0..6usize, 0..2usize));
    with_photographs(folders.prop_map(|(views, bytes, missing, name)| {
        // One image may be missing.
        let images = (0..views).filter(|i| views == 1 || *i != missing);
        let names = images.map(|i| format!("image/{i:03}.png")).collect();
        let name = ["cameras_sphere.npz", "cameras.npz"][name];
        (Case::default().file(name, bytes), names)
    }))
}

/// A folder of a Middlebury data set.
pub(crate) fn middlebury() -> BoxedStrategy<Case> {
    let table = |views: usize| {
        let centre = f64::from(SIZE) / 2.0;
        let k = [FOCAL, 0.0, centre, 0.0, FOCAL, centre, 0.0, 0.0, 1.0];
        let mut text = format!("{views}\n");
        for i in 0..views {
            let (rotation, t) = (axes(i), TRANSLATION);
            let numbers = [&k[..], rotation.as_flattened(), &t].concat();
            let _ = writeln!(text, "{i:03}.png {}", words(&numbers));
        }
        Lines::new(&text, ' ')
    };
    let tables = (1..5usize).prop_flat_map(move |views| (Just(views), spoiled(Just(table(views)))));
    with_photographs(tables.prop_map(|(views, table)| {
        let names = (0..views).map(|i| format!("{i:03}.png")).collect();
        (Case::default().file("toy_par.txt", table.to_bytes()), names)
    }))
}

/// Camera models of COLMAP with their numbers in binary files and their parameters.
const MODELS: [(&str, u64, &[f64]); 10] = [
    ("SIMPLE_PINHOLE", 0, &[FOCAL, 4.0, 4.0]),
    ("PINHOLE", 1, &[FOCAL, FOCAL, 4.0, 4.0]),
    ("SIMPLE_RADIAL", 2, &[FOCAL, 4.0, 4.0, 0.1]),
    ("RADIAL", 3, &[FOCAL, 4.0, 4.0, 0.1, 0.01]),
    ("OPENCV", 4, &[FOCAL, FOCAL, 4.0, 4.0, 0.1, 0.01, 0.001, 0.0]),
    ("OPENCV_FISHEYE", 5, &[FOCAL, FOCAL, 4.0, 4.0, 0.1, 0.01, 0.001, 0.0]),
    ("FULL_OPENCV", 6, &[FOCAL, FOCAL, 4.0, 4.0, 0.1, 0.01, 0.001, 0.0, 0.01, 0.1, 0.01, 0.0]),
    ("SIMPLE_RADIAL_FISHEYE", 8, &[FOCAL, 4.0, 4.0, 0.1]),
    ("RADIAL_FISHEYE", 9, &[FOCAL, 4.0, 4.0, 0.1, 0.01]),
    ("THIN_PRISM_FISHEYE", 10, &[4.0, 4.0, 4.0, 4.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0]),
];

/// The quaternion (w, x, y, z) of camera `i`: half a turn about x after a turn about y.
fn quaternion(i: usize) -> [f64; 4] {
    let (sin, cos) = (i as f64 * 0.45).sin_cos();
    [0.0, cos, 0.0, sin]
}

/// The files of a model of COLMAP as text: cameras, images, points.
fn text_model(model: usize, views: usize, points: usize) -> [Lines; 3] {
    let (name, _, parameters) = MODELS[model];
    let cameras = format!("# cameras\n1 {name} {SIZE} {SIZE} {}\n", words(parameters));
    let mut images = "# images\n".to_owned();
    for i in 0..views {
        let numbers = words(&[&quaternion(i)[..], &TRANSLATION].concat());
        let _ = writeln!(images, "{} {numbers} 1 {i:03}.png\n1.5 2.5 1", i + 1);
    }
    let mut table = "# points\n".to_owned();
    for i in 0..points {
        let _ = writeln!(table, "{i} 0.{i} 0 -0.{i} 255 0 0 0.5 1 0");
    }
    [cameras, images, table].map(|text| Lines::new(&text, ' '))
}

/// The files of a model of COLMAP in binary form: cameras, images, points.
fn binary_model(model: usize, views: usize, points: usize) -> [Layout; 3] {
    let (_, number, parameters) = MODELS[model];
    let start = |count: usize| Layout::default().integer(count as u64, 8);
    let cameras = start(1)
        .integer(1, 4)
        .integer(number, 4)
        .integer(SIZE.into(), 8)
        .integer(SIZE.into(), 8)
        .doubles(parameters);
    let images = (0..views).fold(start(views), |layout, i| {
        layout
            .integer(i as u64 + 1, 4)
            .doubles(&quaternion(i))
            .doubles(&TRANSLATION)
            .integer(1, 4)
            .bytes(format!("{i:03}.png\0"))
            .integer(1, 8)
            .doubles(&[1.5, 2.5])
            .integer(1, 8)
    });
    let points = (0..points).fold(start(points), |layout, i| {
        layout
            .integer(i as u64, 8)
            .doubles(&[0.1 * i as f64, 0.0, -0.1])
            .bytes([255, 0, 0])
            .float(0.5, 8)
            .integer(1, 8)
            .integer(1, 4)
            .integer(0, 4)
    });
    [cameras, images, points]
}

/// Harms one of the three files of a model.
fn one_of_three<T: crate::spoil::Spoil>(files: [T; 3]) -> BoxedStrategy<[T; 3]> {
    let [cameras, images, points] = files;
    (0..3usize)
        .prop_flat_map(move |which| {
            let file = |i: usize, file: &T| {
                let plain = Just(file.clone());
                if i == which { spoiled(plain) } else { sometimes_spoiled(plain) }
            };
            [file(0, &cameras), file(1, &images), file(2, &points)]
        })
        .boxed()
}

/// The places of a model and of its images.
const PLACES: [(&str, &str); 4] = [
    ("sparse/0", "images"),
    ("sparse", "input"),
    ("colmap/sparse/0", "images"),
    ("sparse/0", "images_2"),
];

/// A folder of a COLMAP model, as text or in binary form, with its images.
pub(crate) fn colmap() -> BoxedStrategy<Case> {
    let counts = (0..MODELS.len(), 1..5usize, 0..6usize, any::<bool>(), 0..PLACES.len());
    let models = counts.prop_flat_map(|(model, views, points, binary, place)| {
        let files: BoxedStrategy<[Vec<u8>; 3]> = if binary {
            let files = one_of_three(binary_model(model, views, points));
            files.prop_map(|files| files.map(|layout| layout.to_bytes())).boxed()
        } else {
            let files = one_of_three(text_model(model, views, points));
            files.prop_map(|files| files.map(|lines| lines.to_bytes())).boxed()
        };
        (Just((views, binary, place)), files)
    });
    with_photographs(models.prop_map(|((views, binary, place), [cameras, images, points])| {
        let extension = if binary { "bin" } else { "txt" };
        let (model, folder) = PLACES[place];
        // A smaller model, in text.
        let [small_cameras, small_images, _] = text_model(0, 1, 0);
        let case = Case::default()
            .file(format!("{model}/cameras.{extension}"), cameras)
            .file(format!("{model}/images.{extension}"), images)
            .file(format!("{model}/points3D.{extension}"), points)
            .file("sparse/7/cameras.txt", small_cameras.to_bytes())
            .file("sparse/7/images.txt", small_images.to_bytes());
        (case, (0..views).map(|i| format!("{folder}/{i:03}.png")).collect())
    }))
}

/// A data set of any format, in the folder `data`.
pub(crate) fn any_dataset() -> BoxedStrategy<Case> {
    let more = prop_oneof![
        forms::llff(),
        forms::blended_mvs(),
        forms::metashape(),
        forms::sdfstudio(),
        forms::splats(),
    ];
    prop_oneof![nerf(), neus(), middlebury(), colmap(), more]
        .prop_map(|case| Case::default().case("data", case))
        .boxed()
}

/// A valid data set of three views.
pub(crate) fn small_dataset() -> Case {
    let case = Case::default().file("transforms.json", transforms(3, 0, 99).json());
    (0..3)
        .fold(case, |case, i| case.file(format!("images/{i:03}.png"), photograph([SIZE; 2], false)))
}
