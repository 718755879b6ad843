//! Warps a film: the field V of a ball tends to the velocity of its outline.

#![allow(clippy::print_stdout, reason = "a program")]

use field::Shape;
use glam::DVec3;
use warp::{Pinhole, WarpOptions, WarpedRay, evaluate};

fn main() {
    let (eye, ball) = (DVec3::new(0.0, 0.0, 4.0), Shape::<f64>::sphere([0.0; 3], 1.0));
    let chart = Pinhole::looking_at(eye, DVec3::ZERO, DVec3::Y, 100.0);
    println!("distance from the ball, V in pixels per unit of the radius:");
    for gap in [0.3, 0.1, 0.03, 0.01, 1e-3] {
        let sine: f64 = (1.0 + gap) / 4.0; // It passes the ball at this distance.
        let direction = DVec3::new(sine, 0.0, -(1.0 - sine * sine).sqrt());
        let ray = trace::Ray {
            origin: eye,
            direction,
            near: 2.0,
            far: 6.0,
            scale: 1.0,
            spread: 0.0,
            reach: f64::INFINITY,
        };
        // With 22 steps, as in renders, the last ray ends before its closest point.
        let visits = trace::visit(&ball, &[ray], 200, 1.0);
        let trace::Visited { t, f, gradient, step, clamped, valid } = visits.ray(0);
        let ray = WarpedRay {
            origin: eye,
            direction,
            direction_du: [DVec3::ZERO; 2],
            entry_du: [0.0; 2],
            exit_du: [0.0; 2],
            relaxation: 1.0,
            t,
            f,
            gradient,
            step,
            clamped,
            valid,
        };
        let weighting = WarpOptions::IMAGE.weighting::<f64>(2.0); // A bounding radius of 2.
        let warp = evaluate(&weighting, 14, &[&chart], &[ray]);
        // ∂f/∂radius = −1 at all points.
        let velocity = warp.velocity(&vec![-1.0; warp.samples.len()])[0];
        println!("{gap:8}: {:.2}", velocity[0]);
    }
    // The outline has the film radius 100 r/√(16 − r²).
    println!(" outline: {:.2}", 1600.0 / 15f64.powf(1.5));
}
