//! Scene files.

use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::case::Case;
use crate::formats::models::{Tensors, fields, heads};
use crate::spoil::{sometimes_spoiled, spoiled};
use crate::tree::Tree;

fn vector() -> impl Strategy<Value = Value> + Clone {
    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0].prop_map(|v| json!(v.map(|x| (x * 100.0).round() / 100.0)))
}

fn positive() -> impl Strategy<Value = f64> + Clone {
    (1..20u32).prop_map(|n| f64::from(n) * 0.05)
}

fn cameras() -> impl Strategy<Value = Value> {
    let poses = prop_oneof![
        Just(json!({"eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]})),
        Just(json!({"pose": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]})),
    ];
    let focals = prop_oneof![Just(json!(16)), Just(json!([16.5, 15.5]))];
    (poses, focals, 1..16u32, 1..16u32).prop_map(|(mut camera, focal, width, height)| {
        camera["width"] = json!(width);
        camera["height"] = json!(height);
        camera["focal"] = focal;
        camera["principal"] = json!([4, 4.5]);
        camera
    })
}

/// Shapes and combinations of them, three levels deep.
fn sdfs() -> impl Strategy<Value = Value> {
    let shapes = prop_oneof![
        (vector(), positive())
            .prop_map(|(c, r)| json!({"type": "sphere", "center": c, "radius": r})),
        (vector(), positive())
            .prop_map(|(c, r)| json!({"type": "box", "center": c, "half_size": [r, 0.5, 0.25]})),
        (vector(), positive()).prop_map(|(c, r)| json!(
            {"type": "torus", "center": c, "axis": [0, 0, 1], "major": r, "minor": 0.1})),
        (vector(), positive())
            .prop_map(|(c, r)| json!({"type": "capsule", "a": c, "b": [0, 0, 1], "radius": r})),
        positive().prop_map(|r| json!({"type": "plane", "normal": [0, 1, 0], "offset": r})),
        Just(json!({"type": "neural", "weights": "model.safetensors"})),
    ];
    shapes.prop_recursive(3, 12, 3, |inner| {
        let kinds = prop::sample::select(vec!["union", "intersection", "subtraction"]);
        let children = vec(inner, 1..4);
        prop_oneof![
            3 => (kinds, children.clone())
                .prop_map(|(kind, children)| json!({"type": kind, "children": children})),
            1 => children
                .prop_map(|inner| json!({"type": "smooth_union", "k": 0.1, "children": inner})),
        ]
    })
}

fn appearances() -> impl Strategy<Value = Value> {
    let lights = prop_oneof![
        vector().prop_map(|v| json!(
            {"type": "directional", "direction": v, "radiance": [1, 1, 1]})),
        vector().prop_map(|v| json!({"type": "point", "position": v, "intensity": [2, 1, 1]})),
    ];
    let lambert = (vec(lights, 0..6), any::<bool>()).prop_map(|(lights, shadows)| {
        json!(
        {"type": "lambert", "albedo": [0.5, 0.6, 0.7], "ambient": [0, 0, 0], "lights": lights,
         "shadows": shadows})
    });
    prop_oneof![
        Just(json!({"type": "constant", "radiance": [1, 0.5, 0]})),
        lambert,
        Just(json!({"type": "normal"})),
        Just(json!({"type": "neural", "weights": "radiance.safetensors"})),
    ]
}

fn scenes() -> impl Strategy<Value = Tree> {
    (cameras(), sdfs(), appearances()).prop_map(|(camera, sdf, appearance)| {
        json!({"camera": camera, "sdf": sdf, "appearance": appearance, "background": [0, 0, 0.1]})
            .into()
    })
}

/// A file `scene.json` with its model files.
pub(crate) fn scene_files() -> BoxedStrategy<Case> {
    let model = |strategy: BoxedStrategy<Tensors>| sometimes_spoiled(strategy);
    (spoiled(scenes()), model(fields()), model(heads()))
        .prop_map(|(scene, field, head)| {
            Case::default()
                .file("scene.json", scene.json())
                .file("model.safetensors", field.to_bytes())
                .file("radiance.safetensors", head.to_bytes())
        })
        .boxed()
}
