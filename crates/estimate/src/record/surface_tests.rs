use super::*;
use glam::DVec2;
use proptest::prelude::*;
use render::Camera;
use scene::Scene;
use serde_json::json;
use std::path::Path;

/// A smooth solid under two lights.
fn file() -> serde_json::Value {
    json!({
        "camera": {"width": 32, "height": 32, "focal": 50.0, "principal": [16, 16],
                   "eye": [0.6, -0.4, 3.6], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "smooth_union", "k": 0.3, "children": [
            {"type": "sphere", "center": [0.2, 0.1, 0], "radius": 0.6},
            {"type": "torus", "center": [-0.1, 0, 0.1], "axis": [0.3, 0.2, 1], "major": 0.7, "minor": 0.25}]},
        "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2], "lights": [
            {"type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 0.9, 0.8]},
            {"type": "point", "position": [1, 1, 3], "intensity": [4, 5, 6]}]},
        "background": [0.1, 0.2, 0.3]
    })
}

fn scene(file: &serde_json::Value) -> Scene {
    Scene::from_value(Path::new("scene.json"), file).unwrap()
}

/// δ·L of one sample, by tracing and shading alone; `None` where nothing is hit.
fn seen(scene: &Scene, u: DVec2, adjoint: glam::DVec3) -> Option<f64> {
    with(scene, |setup| {
        let primary = setup.primary(&[Sample { camera: 0, u }]);
        (!primary.hits.is_empty()).then(|| primary.radiance[0].dot(adjoint))
    })
}

fn with<T>(scene: &Scene, f: impl FnOnce(&Setup<'_, f64>) -> T) -> T {
    let field = scene.sdf.build::<f64>().unwrap();
    let shader = scene.shader::<f64>(&*field).unwrap();
    let cameras: [Camera; 1] = [scene.camera];
    f(&Setup::new(&*field, &*shader, &cameras, &scene.bounds, scene.background.into()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// By the parameters of the field and by the film, through hit and normal: against tracing
    /// anew.
    #[test]
    fn the_reverse_mode_matches_retracing(u in prop::array::uniform2(6.0..26.0f64), adjoint in prop::array::uniform3(-1.0..1.0f64)) {
        const H: f64 = 1e-5;
        let (file, u, adjoint) = (file(), DVec2::from(u), glam::DVec3::from(adjoint));
        let scene = scene(&file);
        let found = with(&scene, |setup| {
            let samples = [Sample { camera: 0, u }];
            let primary = setup.primary(&samples);
            // Near a silhouette or a light's edge differences mean nothing.
            let steep = |i: usize| -primary.normal[i].dot(primary.direction[i]) > 0.25;
            let lit = |i: usize| primary.normal[i].dot(glam::DVec3::new(0.3, 0.5, 0.8)) > 0.05
                && primary.normal[i].dot(glam::DVec3::new(1.0, 1.0, 3.0) - primary.x[i]) > 0.05;
            if primary.hits.is_empty() || !steep(0) || !lit(0) {
                return None;
            }
            let mut shader = vec![0.0; setup.shader.parameter_count()];
            let surface = setup.surface_vjp(&samples, &primary, &[adjoint], &mut shader);
            let mut gradient = vec![0.0; setup.field.parameter_count()];
            setup.field.parameter_vjp(&primary.x, &surface.alpha, &surface.c, &mut gradient);
            Some((gradient, surface.film[0]))
        });
        let Some((gradient, film)) = found else { return Ok(()) };
        let close = |got: f64, plus: Option<f64>, minus: Option<f64>, what: String| {
            let (Some(plus), Some(minus)) = (plus, minus) else { return Ok(()) };
            let difference = (plus - minus) / (2.0 * H);
            prop_assert!((got - difference).abs() < 1e-4 * (1.0 + difference.abs()), "{what}: {got} against {difference}");
            Ok(())
        };
        for (axis, e) in [DVec2::X, DVec2::Y].into_iter().enumerate() {
            close(film[axis], seen(&scene, u + e * H, adjoint), seen(&scene, u - e * H, adjoint), format!("film {axis}"))?;
        }
        for (gradient, pointer) in gradient.iter().zip(scene.sdf.pointers()) {
            let Some(pointer) = pointer else { continue };
            let moved = |h: f64| {
                let mut moved = file.clone();
                let number = moved.pointer_mut(&pointer).unwrap();
                *number = json!(number.as_f64().unwrap() + h);
                seen(&self::scene(&moved), u, adjoint)
            };
            close(*gradient, moved(H), moved(-H), pointer.clone())?;
        }
    }
}
