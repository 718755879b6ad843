//! Samples that are dealt to parts and joined again are the same samples.

use field::UniformBackground;
use field::{Shape, Sphere};
use glam::{DVec2, DVec3};
use render::{Analytic, Camera, Formula, Primary, Sample, Scene};

fn scene_of<T>(run: impl FnOnce(&Scene<'_, f64>) -> T) -> T {
    let ball = Shape::<f64>::sphere([0.1, 0.0, 0.0], 0.5);
    let shader = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let (focal, centre, eye) = (DVec2::splat(12.0), DVec2::splat(8.0), DVec3::new(0.0, 0.5, 3.0));
    let camera = Camera::look_at(16, 16, focal, centre, eye, DVec3::ZERO, DVec3::Y);
    let camera = camera.unwrap_or_else(|| panic!("a camera"));
    let (cameras, bounds) = ([camera], Sphere { center: DVec3::ZERO, radius: 1.0 });
    let black = UniformBackground(DVec3::ZERO);
    run(&Scene::new(&ball, &shader, &cameras, &bounds, &black))
}

/// Everything that a batch knows, as text.
fn all(primary: &Primary<f64>) -> String {
    format!("{primary:?}")
}

#[test]
fn parts_have_the_samples_rays_and_hits_of_their_own_batches() {
    scene_of(|scene| {
        // Of these some miss the ball of rays, some miss the solid, and some hit.
        let sample = |i: u32| Sample {
            camera: 0,
            u: DVec2::new(f64::from(i % 16) + 0.3, f64::from(i / 16) + 0.6),
        };
        let samples: Vec<Sample> = (0..256).map(sample).collect();
        let whole = scene.primary(&samples).unwrap();
        let with_ray = whole.samples.iter().filter(|sample| sample.ray.is_some()).count();
        assert!(whole.hits.len() > 10 && with_ray > whole.hits.len() + 10 && with_ray < 250);
        let part: Vec<usize> = (0..256).map(|i| i * i % 4).collect();
        let parts = whole.clone().deal(4, &part);
        for (number, dealt) in parts.iter().enumerate() {
            let own: Vec<Sample> =
                samples.iter().zip(&part).filter(|(_, p)| **p == number).map(|(s, _)| *s).collect();
            assert_eq!(all(dealt), all(&scene.primary(&own).unwrap()), "part {number}");
        }
        let halves: Vec<usize> = (0..256).map(|i| i / 100).collect();
        let mut joined = Primary::default();
        whole.clone().deal(3, &halves).into_iter().for_each(|own| joined.append(own));
        assert_eq!(all(&joined), all(&whole));
    });
}
