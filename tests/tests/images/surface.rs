//! The derivatives of a hit by film position, field and shader, against differences of samples.

use estimate::record::surface_vjp;
use field::PartialSum;
use glam::{DVec2, DVec3};
use proptest::prelude::*;
use render::{Primary, Sample, Scene};
use scene::SceneFile;
use serde_json::json;
use std::path::Path;

/// A smooth solid under two lights.
fn file() -> serde_json::Value {
    json!({
        "camera": {"width": 32, "height": 32, "focal": 50.0, "principal": [16, 16],
                   "eye": [0.6, -0.4, 3.6], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "smooth_union", "k": 0.3, "children": [
            {"type": "sphere", "center": [0.2, 0.1, 0], "radius": 0.6},
            {"type": "torus", "center": [-0.1, 0, 0.1], "axis": [0.3, 0.2, 1],
             "major": 0.7, "minor": 0.25}]},
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2],
            "lights": [
                {"type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 0.9, 0.8]},
                {"type": "point", "position": [1, 1, 3], "intensity": [4, 5, 6]}
            ]
        },
        "background": [0.1, 0.2, 0.3]
    })
}

fn read(file: &serde_json::Value) -> SceneFile {
    SceneFile::from_value(Path::new("scene.json"), file).unwrap()
}

/// δ·L of one sample, by tracing and shading alone; `None` without a hit.
fn radiance(file: &SceneFile, u: DVec2, adjoint: DVec3) -> Option<f64> {
    with_scene(file, |scene| {
        let primary = scene.primary(&[Sample { camera: 0, u }]).unwrap();
        (!primary.hits.is_empty()).then(|| primary.samples[0].radiance.dot(adjoint))
    })
}

fn with_scene<T>(file: &SceneFile, run: impl FnOnce(&Scene<'_, f64>) -> T) -> T {
    let field = file.field::<f64>().unwrap();
    let shader = file.shader::<f64>(&*field).unwrap();
    let cameras = [file.camera];
    let background = file.background().unwrap();
    run(&Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background))
}

/// Whether the only hit is far enough from silhouettes and from the horizons of the lights for
/// finite differences.
fn is_clear(primary: &Primary<f64>) -> bool {
    let (n, d, x) = (primary.surface.normal[0], primary.surface.direction[0], primary.surface.x[0]);
    -n.dot(d) > 0.25
        && n.dot(DVec3::new(0.3, 0.5, 0.8)) > 0.05
        && n.dot(DVec3::new(1.0, 1.0, 3.0) - x) > 0.05
}

/// The gradient by the field's parameters and the film gradient of δ·L at a film position, in
/// reverse mode.
fn reverse(file: &SceneFile, u: DVec2, adjoint: DVec3) -> Option<(Vec<f64>, [f64; 2])> {
    with_scene(file, |scene| {
        let primary = scene.primary(&[Sample { camera: 0, u }]).unwrap();
        if primary.hits.is_empty() || !is_clear(&primary) {
            return None;
        }
        let mut shader = PartialSum::zero(scene.shader.parameter_count(), 0..0);
        let surface = surface_vjp(scene, &primary, &[adjoint], &[], &mut shader)[0];
        let mut gradient = vec![0.0; scene.field.parameter_count()];
        let x = &primary.surface.x;
        scene.field.parameter_vjp(x, &[surface.alpha], &[surface.c], &mut gradient);
        Some((gradient, surface.film))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The derivatives by the parameters of the field and by the film position, through hit point
    /// and normal, against differences of traced and shaded samples.
    #[test]
    fn reverse_mode_matches_differences(
        u in prop::array::uniform2(6.0..26.0f64),
        adjoint in prop::array::uniform3(-1.0..1.0f64),
    ) {
        const H: f64 = 1e-5;
        let (value, u, adjoint) = (file(), DVec2::from(u), DVec3::from(adjoint));
        let file = read(&value);
        let Some((gradient, film)) = reverse(&file, u, adjoint) else { return Ok(()) };
        let close = |got: f64, plus: Option<f64>, minus: Option<f64>, name: String| {
            let (Some(plus), Some(minus)) = (plus, minus) else { return Ok(()) };
            let difference = (plus - minus) / (2.0 * H);
            prop_assert!(
                (got - difference).abs() < 1e-4 * (1.0 + difference.abs()),
                "{name}: {got} against {difference}"
            );
            Ok(())
        };
        for (axis, e) in [DVec2::X, DVec2::Y].into_iter().enumerate() {
            let moved = |h: f64| radiance(&file, u + e * h, adjoint);
            close(film[axis], moved(H), moved(-H), format!("film {axis}"))?;
        }
        for (gradient, pointer) in gradient.iter().zip(file.sdf.pointers()) {
            let Some(pointer) = pointer else { continue };
            let moved = |h: f64| {
                let mut moved = value.clone();
                let number = moved.pointer_mut(&pointer).unwrap();
                *number = json!(number.as_f64().unwrap() + h);
                radiance(&read(&moved), u, adjoint)
            };
            close(*gradient, moved(H), moved(-H), pointer.clone())?;
        }
    }
}
