//! Passes of networks as parts of the machine's peak.

use std::time::Instant;

use field::Field;
use glam::Vec3;
use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};
use serde::Serialize;

use crate::peak::Peak;

/// One pass of one network.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PassResult {
    network: String,
    pass: &'static str,
    points_per_second: f64,
    /// Of matrix work alone.
    gflops: f64,
    percent_of_peak: f64,
    two_threads_over_one: f64,
}

const POINTS: usize = 8192;

/// A measurement lasts so long at least; the best of `TRIES` counts.
const SECONDS: f64 = 0.15;
const TRIES: usize = 10;

type Work<'a> = &'a (dyn Fn(&[Vec3]) + Sync);

/// Points a second of `work` over chunks of points on `threads` threads.
fn rate(points: &[Vec3], threads: usize, work: Work<'_>) -> f64 {
    let each = points.len() / threads;
    let run = || {
        let (start, mut rounds) = (Instant::now(), 0);
        while start.elapsed().as_secs_f64() < SECONDS {
            std::thread::scope(|scope| {
                for part in points.chunks(each).skip(1) {
                    scope.spawn(move || (0..ROUNDS).for_each(|_| work(part)));
                }
                (0..ROUNDS).for_each(|_| work(&points[..each]));
            });
            rounds += ROUNDS;
        }
        (rounds * points.len()) as f64 / start.elapsed().as_secs_f64()
    };
    (0..TRIES).map(|_| run()).fold(0.0, f64::max)
}

/// Passes between two looks at the clock: starting a thread is not what is measured.
const ROUNDS: usize = 8;

/// Measures and prints.
pub(crate) fn measure(peak: &Peak) -> Vec<PassResult> {
    let points: Vec<Vec3> = (0..POINTS)
        .map(|i| Vec3::new((i as f32).sin(), (1.3 * i as f32).cos(), 0.2) * 0.7)
        .collect();
    let mut results = Vec::new();
    for (width, layers) in [(64, 3), (64, 4), (256, 8)] {
        let net = network(width, layers);
        let name = format!("{layers} × {width}, 6 octaves");
        // 1×, 2×, 4× and 6× of the value pass.
        let value = |x: &[Vec3]| net.value(x, &mut vec![0.0; x.len()]);
        let gradient = |x: &[Vec3]| {
            net.value_gradient(x, &mut vec![0.0; x.len()], &mut vec![Vec3::ZERO; x.len()])
        };
        let hessian = |x: &[Vec3]| {
            net.hessian_vector(
                x,
                x,
                &mut vec![Vec3::ZERO; x.len()],
                &mut vec![Vec3::ZERO; x.len()],
            );
        };
        let parameters = |x: &[Vec3]| {
            net.parameter_vjp(x, &vec![0.5; x.len()], x, &mut vec![0.0; net.parameters().len()]);
        };
        let passes: [(&'static str, f64, Work<'_>); 4] = [
            ("value", 1.0, &value),
            ("value + gradient", 2.0, &gradient),
            ("Hessian–vector", 4.0, &hessian),
            ("parameter VJP", 6.0, &parameters),
        ];
        for (pass, times, work) in passes {
            let (one, two) = (rate(&points, 1, work), rate(&points, 2, work));
            let gflops = one * times * 2.0 * multiply_adds(width, layers) as f64 / 1e9;
            let result = PassResult {
                network: name.clone(),
                pass,
                points_per_second: one,
                gflops,
                percent_of_peak: 100.0 * gflops / peak.gflops,
                two_threads_over_one: two / one,
            };
            eprintln!(
                "| {name} | {pass} | {:.3} | {gflops:.0} | {:.0} % | {:.2} |",
                one / 1e6,
                result.percent_of_peak,
                result.two_threads_over_one
            );
            results.push(result);
        }
    }
    results
}

/// Weights of the network's matrices.
fn multiply_adds(width: usize, layers: usize) -> usize {
    FEATURES * width + (layers - 1) * width * width + width
}

const BANDS: usize = 6;
const FEATURES: usize = 3 + 6 * BANDS;

fn network(width: usize, layers: usize) -> Network<f32> {
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: BANDS },
        hidden: vec![width; layers],
        skip: vec![],
        activation: Activation::Softplus { beta: 100.0 },
    };
    Network::geometric(architecture, Transform::default(), 0.5, 1)
}
