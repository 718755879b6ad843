//! Fits a ball to a silhouette: its centre and its radius, by the gradient of an image loss.

#![allow(clippy::print_stdout, reason = "a program")]

use estimate::gradient::{Sampling, target_gradient};
use estimate::{Refined, SampleCounts};
use field::UniformBackground;
use field::{Shape, Sphere};
use glam::{DVec2, DVec3};
use optim::{Adam, Group};
use render::{Analytic, Camera, Formula, Scene, render};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let white = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let black = UniformBackground(DVec3::ZERO);
    let (eye, center) = (DVec3::new(0.0, 0.0, 4.0), DVec2::splat(12.0));
    let camera = Camera::look_at(24, 24, DVec2::splat(40.0), center, eye, DVec3::ZERO, DVec3::Y);
    let cameras = [camera.ok_or("the camera looks along its upward direction")?];
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.4 };
    let ball = |p: &[f64; 3]| Shape::<f64>::sphere([p[0], p[1], 0.0], p[2]);
    let truth = ball(&[0.2, -0.1, 0.6]);
    let target = Scene::new(&truth, &white, &cameras, &bounds, &black);
    let target = render(&target, 0, 256, 7, &|_| {})?.film;
    let mut p = [0.0, 0.0, 0.4];
    let mut adam = Adam::<f64>::new(3, vec![Group::new("ball", 0..3)]);
    for i in 0..120 {
        let field = ball(&p);
        let scene = Scene::new(&field, &white, &cameras, &bounds, &black);
        let sampling = Sampling { counts: SampleCounts { spp: 4, edge_samples: 4 }, seed: i };
        let found = target_gradient(&scene, &target, &Refined, sampling, &|_| {})?;
        // The parameters of a ball are the coordinates of its centre, and its radius.
        let [x, y, _, radius] = found.parameters[..] else { return Err("no ball".into()) };
        adam.step(&mut p, &[x, y, radius], 0.02 * 0.97_f64.powi(i as i32))?;
        if i % 20 == 19 {
            println!(
                "loss {:6.3}, centre {:.3}, {:.3}, radius {:.3}",
                found.loss, p[0], p[1], p[2]
            );
        }
    }
    println!("true centre 0.200, -0.100, radius 0.600");
    Ok(())
}
