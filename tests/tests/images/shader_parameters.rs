//! Derivative images by parameters of the shader: their cost by counted passes of the shader.

use std::sync::atomic::{AtomicUsize, Ordering};

use estimate::gradient::{Derivative, Direction, Sampling, differentiate};
use estimate::{Refined, SampleCounts};
use field::{Shader, UniformBackground};
use field::{Shape, Sphere, SurfaceAdjoint, SurfaceBatch};
use glam::{DVec2, DVec3};
use render::{Analytic, Camera, Formula, Light, Scene};

/// A shader that counts the points of its reverse passes.
struct Counted {
    shader: Analytic<f64>,
    points: AtomicUsize,
}

impl Shader<f64> for Counted {
    fn parameter_count(&self) -> usize {
        self.shader.parameter_count()
    }
    fn radiance(&self, points: &SurfaceBatch<'_, f64>, rgb: &mut [DVec3]) {
        self.shader.radiance(points, rgb);
    }
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, f64>,
        adjoint: &[DVec3],
        bars: &mut SurfaceAdjoint<f64>,
        parameters: &mut [f64],
    ) {
        self.points.fetch_add(points.len(), Ordering::Relaxed);
        self.shader.vjp(points, adjoint, bars, parameters);
    }
}

/// A ball under three lights: the derivative images in these directions, and the number of points
/// of the shader's reverse passes.
fn derivatives(directions: &[Direction]) -> (Vec<Derivative>, usize) {
    let lights = vec![Light::Directional, Light::Point, Light::Directional];
    let mut parameters = vec![0.8, 0.6, 0.4, 0.1, 0.2, 0.3];
    parameters.extend([0.3, 0.5, 0.9, 1.0, 0.9, 0.8]);
    parameters.extend([-1.0, 2.0, 1.5, 2.0, 3.0, 4.0]);
    parameters.extend([0.9, -0.2, 0.6, 0.3, 0.4, 0.2]);
    let shader = Counted {
        shader: Analytic { formula: Formula::Lambert { lights }, parameters },
        points: AtomicUsize::new(0),
    };
    let ball = Shape::sphere([0.05, 0.03, 0.0], 0.7);
    let (focal, middle, eye) = (DVec2::splat(16.0), DVec2::splat(4.0), DVec3::Z * 4.0);
    let camera = Camera::look_at(8, 8, focal, middle, eye, DVec3::ZERO, DVec3::Y);
    let (cameras, bounds) = ([camera.unwrap()], Sphere { center: DVec3::ZERO, radius: 1.0 });
    let scene = Scene::new(&ball, &shader, &cameras, &bounds, &UniformBackground(DVec3::ZERO));
    let sampling = Sampling { counts: SampleCounts { spp: 16, edge_samples: 8 }, seed: 1 };
    let images = differentiate(&scene, directions, &Refined, sampling, &|_| {}).unwrap();
    (images, shader.points.into_inner())
}

#[test]
fn all_parameters_of_a_shader_cost_as_many_reverse_passes_as_one() {
    let all: Vec<Direction> = (0..24).map(Direction::Shader).collect();
    let (images, points) = derivatives(&all);
    for (direction, image) in all.iter().zip(&images) {
        let (alone, points_alone) = derivatives(&[*direction]);
        assert_eq!(points, points_alone, "{direction:?}");
        assert_eq!(image.film.pixels, alone[0].film.pixels, "{direction:?}");
    }
}
