//! The gradient of an image loss by the weights of a network, against derivative images of
//! `contour` along random directions.

use std::path::Path;

use estimate::gradient::{Direction, Sampling, differentiate, random_unit, target_gradient};
use estimate::{Contour, Refined, SampleCounts};
use render::{Scene, render};
use scene::SceneFile;

const DIRECTIONS: u64 = 4;

fn load(path: &Path) -> SceneFile {
    SceneFile::load(path).unwrap()
}

#[test]
fn the_target_gradient_of_a_network_agrees_with_contour() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("gradients");
    for look in ["constant", "lambert"] {
        let file = load(&folder.join(format!("network.{look}.json")));
        let field = file.field::<f64>().unwrap();
        let shader = file.shader::<f64>(&*field).unwrap();
        let cameras = [file.camera];
        let background = file.background().unwrap();
        let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background);
        // The target: the same view of another solid.
        let other = load(&folder.join(format!("off-axis.{look}.json")));
        let ball = other.field::<f64>().unwrap();
        let behind = other.background().unwrap();
        let seen = Scene::new(&*ball, &*shader, &cameras, &other.bounds, &*behind);
        let target = render(&seen, 0, 64, 9, &|_| {}).unwrap().film;
        let image = render(&scene, 0, 1024, 6, &|_| {}).unwrap().film;

        let sampling =
            |spp| Sampling { counts: SampleCounts { spp, edge_samples: spp / 2 }, seed: 1 };
        let gradient = target_gradient(&scene, &target, &Refined, sampling(256), &|_| {});
        let gradient = gradient.unwrap().parameters;
        let directions: Vec<Direction> = (0..DIRECTIONS).map(Direction::Along).collect();
        let contours = differentiate(&scene, &directions, &Contour, sampling(512), &|_| {});
        let contours = contours.unwrap();
        for (number, derivative) in (0..DIRECTIONS).zip(&contours) {
            let tangent = random_unit::<f64>(gradient.len(), number);
            let along: f64 = gradient.iter().zip(&tangent).map(|(g, t)| g * t).sum();
            let (mut sum, mut scale) = (0.0, 0.0);
            for ((image, target), d) in
                image.pixels.iter().zip(&target.pixels).zip(&derivative.film.pixels)
            {
                for c in 0..3 {
                    let term = f64::from(image[c] - target[c]) * f64::from(d[c]);
                    (sum, scale) = (sum + term, scale + term.abs());
                }
            }
            let off = (along - sum).abs() / scale;
            println!(
                "{look}, direction {number}: {along:.5} against {sum:.5}, off by {:.2} % of Σ|·|",
                100.0 * off
            );
            assert!(off < 0.02, "{look}, direction {number}: {along} against {sum} of {scale}");
        }
    }
}
