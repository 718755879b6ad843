//! Data sets: LLFF, BlendedMVS, Metashape, SDFStudio and 3D Gaussian splatting, each with tiny
//! photographs.

use std::fmt::Write;

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::case::Case;
use crate::formats::arrays::Array;
use crate::formats::meshes;
use crate::formats::views::{FOCAL, SIZE, TRANSLATION, axes, eye, with_photographs, words};
use crate::lines::Lines;
use crate::spoil::{sometimes_spoiled, spoiled};
use crate::tree::Tree;

/// A folder of an LLFF data set; the images may be reduced copies.
pub(crate) fn llff() -> BoxedStrategy<Case> {
    let table = |views: usize, size: f64| {
        let row = |i: usize| {
            let ([right, down, forward], at) = (axes(i), eye(i));
            let last = [size, size, FOCAL * size / f64::from(SIZE)];
            let matrix = (0..3).flat_map(|r| [down[r], right[r], -forward[r], at[r], last[r]]);
            matrix.chain([1.0, 5.0]).collect::<Vec<f64>>()
        };
        Array::table(&(0..views).map(row).collect::<Vec<_>>())
    };
    let counts = (1..5usize, any::<bool>(), 0..9usize);
    let sets = counts.prop_flat_map(move |(views, is_reduced, missing)| {
        let size = f64::from(if is_reduced { 4 * SIZE } else { SIZE });
        (Just((views, is_reduced, missing)), spoiled(Just(table(views, size))))
    });
    with_photographs(sets.prop_map(|((views, is_reduced, missing), table)| {
        let folder = if is_reduced { "images_4" } else { "images" };
        let images = (0..views).filter(|i| views == 1 || *i != missing);
        let names = images.map(|i| format!("{folder}/{i:03}.png")).collect();
        (Case::default().file("poses_bounds.npy", table.to_bytes()), names)
    }))
}

/// A folder of a BlendedMVS data set.
pub(crate) fn blended_mvs() -> BoxedStrategy<Case> {
    let camera = |i: usize| {
        let (axes, t, half) = (axes(i), TRANSLATION, f64::from(SIZE) / 2.0);
        let mut text = "extrinsic\n".to_owned();
        for (axis, t) in axes.iter().zip(t) {
            let _ = writeln!(text, "{} {t}", words(axis));
        }
        let _ = writeln!(text, "0.0 0.0 0.0 1.0\n\nintrinsic\n{FOCAL} 0.0 {half}");
        let _ = writeln!(text, "0.0 {FOCAL} {half}\n0.0 0.0 1.0\n\n1.0 0.1 128 5.0");
        Lines::new(&text, ' ')
    };
    let sets = (1..5usize, any::<bool>()).prop_flat_map(move |(views, is_blended)| {
        let files: Vec<BoxedStrategy<Lines>> =
            (0..views).map(|i| sometimes_spoiled(Just(camera(i)))).collect();
        (files, Just(is_blended))
    });
    with_photographs(sets.prop_map(|(files, is_blended)| {
        let folder = if is_blended { "blended_images" } else { "images" };
        let names = (0..files.len()).map(|i| format!("{folder}/{i:08}.png")).collect();
        let add = |case: Case, (i, file): (usize, &Lines)| {
            case.file(format!("cams/{i:08}_cam.txt"), file.to_bytes())
        };
        (files.iter().enumerate().fold(Case::default(), add), names)
    }))
}

/// The name of image `i`.
fn image_name(i: usize) -> String {
    format!("images/{i:03}.png")
}

/// A folder with the file that `tree` makes for a number of views and one of three variants.
fn json_set(name: &'static str, tree: fn(usize, usize) -> Value) -> BoxedStrategy<Case> {
    let sets = (1..5usize, 0..3usize).prop_flat_map(move |(views, variant)| {
        let file = spoiled(Just(Tree::from(tree(views, variant))));
        (Just(views), file, meshes::point_clouds())
    });
    with_photographs(sets.prop_map(move |(views, file, points)| {
        let case = Case::default().file(name, file.json()).file("input.ply", points);
        (case, (0..views).map(image_name).collect())
    }))
}

/// A folder with the `meta_data.json` of SDFStudio.
pub(crate) fn sdfstudio() -> BoxedStrategy<Case> {
    json_set("meta_data.json", |views, variant| {
        let half = f64::from(SIZE) / 2.0;
        let frame = |i: usize| {
            let ([right, down, forward], at) = (axes(i), eye(i));
            let row = |r: usize| json!([right[r], down[r], forward[r], at[r]]);
            let k = match variant {
                0 => json!([[FOCAL, 0, half], [0, FOCAL, half], [0, 0, 1]]),
                _ => json!([[FOCAL, 0, half, 0], [0, FOCAL, half, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
            };
            json!({"rgb_path": image_name(i), "foreground_mask": image_name(i), "intrinsics": k,
                   "camtoworld": [row(0), row(1), row(2), [0, 0, 0, 1]]})
        };
        let scene = match variant {
            0 => json!({"aabb": [[-1, -1, -1], [1, 1, 1]], "radius": 1}),
            1 => json!({"aabb": [[-1, -1, -1], [1, 1, 1]]}),
            _ => Value::Null,
        };
        json!({"width": SIZE, "height": SIZE, "scene_box": scene, "camera_model": "OPENCV",
               "frames": (0..views).map(frame).collect::<Vec<_>>()})
    })
}

/// A folder with the `cameras.json` of 3D Gaussian splatting.
pub(crate) fn splats() -> BoxedStrategy<Case> {
    json_set("cameras.json", |views, variant| {
        let camera = |i: usize| {
            let [right, down, forward] = axes(i);
            let row = |r: usize| json!([right[r], down[r], forward[r]]);
            // The size of the photographs, twice that, or none.
            let side = [json!(SIZE), json!(2 * SIZE), Value::Null][variant].clone();
            json!({"id": i, "img_name": format!("{i:03}"), "width": side, "height": side,
                   "position": eye(i), "rotation": [row(0), row(1), row(2)],
                   "fx": FOCAL, "fy": FOCAL})
        };
        (0..views).map(camera).collect()
    })
}

/// A folder with a camera file of Metashape. Its words are harmed: names, numbers, tags. The last
/// camera may be one of a rig.
pub(crate) fn metashape() -> BoxedStrategy<Case> {
    let file = |views: usize, kind: &str| {
        let resolution = format!("<resolution width=\"{SIZE}\" height=\"{SIZE}\"/>");
        let mut text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n\
             <chunk label=\"Chunk\" enabled=\"1\">\n<sensors>\n<sensor id=\"0\" type=\"{kind}\">\n\
             {resolution}\n<calibration type=\"{kind}\" class=\"adjusted\">\n{resolution}\n\
             <f> {FOCAL} </f>\n<cx> 0 </cx>\n<cy> 0 </cy>\n<k1> 0.01 </k1>\n<p1> 0.001 </p1>\n\
             </calibration>\n</sensor>\n</sensors>\n<components>\n<component id=\"0\">\n\
             <transform>\n<rotation> 0 1 0 1 0 0 0 0 -1 </rotation>\n\
             <translation> 1 2 3 </translation>\n<scale> 2 </scale>\n</transform>\n\
             </component>\n</components>\n<cameras>\n"
        );
        for i in 0..views {
            let ([right, down, forward], at) = (axes(i), eye(i));
            let rows = (0..3).flat_map(|r| [right[r], down[r], forward[r], at[r]]);
            let numbers = rows.chain([0.0, 0.0, 0.0, 1.0]).collect::<Vec<f64>>();
            let master = if i > 0 && i + 1 == views { "master_id=\"0\" " } else { "" };
            let _ = writeln!(
                text,
                "<camera id=\"{i}\" {master}sensor_id=\"0\" component_id=\"0\" label=\"{i:03}\">\n\
                 <transform> {} </transform>\n</camera>",
                words(&numbers)
            );
        }
        Lines::new(&(text + "</cameras>\n</chunk>\n</document>\n"), ' ')
    };
    let kinds = prop::sample::select(vec!["frame", "fisheye", "spherical"]);
    let sets = (1..5usize, kinds)
        .prop_flat_map(move |(views, kind)| (Just(views), spoiled(Just(file(views, kind)))));
    with_photographs(sets.prop_map(|(views, file)| {
        let names = (0..views).map(|i| format!("images/{i:03}.png")).collect();
        (Case::default().file("cameras.xml", file.to_bytes()), names)
    }))
}
