//! Differentiates the area of a disc, the image of a ball, by the radius of the ball.

#![allow(clippy::print_stdout, reason = "a program")]

use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{Refined, SampleCounts};
use field::UniformBackground;
use field::{Shape, Sphere};
use glam::{DVec2, DVec3};
use render::{Analytic, Camera, Formula, Scene};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (radius, distance, focal) = (0.7, 4.0, 48.0);
    let ball = Shape::<f64>::sphere([0.0; 3], radius);
    let white = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let black = UniformBackground(DVec3::ZERO);
    let (eye, center) = (DVec3::new(0.0, 0.0, distance), DVec2::splat(12.0));
    let camera = Camera::look_at(24, 24, DVec2::splat(focal), center, eye, DVec3::ZERO, DVec3::Y);
    let cameras = [camera.ok_or("the camera looks along its upward direction")?];
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.4 };
    let scene = Scene::new(&ball, &white, &cameras, &bounds, &black);
    for spp in [4, 16, 64] {
        let sampling = Sampling { counts: SampleCounts { spp, edge_samples: spp }, seed: 1 };
        // Parameter 3 of a ball is its radius.
        let image = differentiate(&scene, &[Direction::Field(3)], &Refined, sampling, &|_| {})?;
        let sum: f64 = image[0].film.pixels.iter().map(|p| f64::from(p[0])).sum();
        println!("{spp:2} samples a pixel: {sum:.2} pixels per unit");
    }
    // The outline has the radius F r/√(D² − r²).
    let square = distance * distance - radius * radius;
    let exact =
        std::f64::consts::TAU * focal * focal * radius * distance * distance / (square * square);
    println!("exact:              {exact:.2}");
    Ok(())
}
