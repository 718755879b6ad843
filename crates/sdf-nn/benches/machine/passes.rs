//! The throughput of network passes, in points per second and as a part of the machine's peak.

use std::time::Instant;

use field::Field;
use glam::Vec3;
use random::Stream;
use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};
use serde::Serialize;

use crate::peak::Peak;

/// One pass of one network.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PassResult {
    network: String,
    pass: &'static str,
    points_per_second: f64,
    /// Matrix work only.
    gflops: f64,
    percent_of_peak: f64,
    two_threads_over_one: f64,
}

/// Points of a batch.
const POINTS: usize = 8192;

/// The least duration of one measurement, in seconds.
const SECONDS: f64 = 0.15;
/// The number of measurements; the fastest counts.
const TRIES: usize = 10;

type Work<'a> = &'a (dyn Fn(&[Vec3]) + Sync);

/// Points per second of `work`, with the points split over `threads` threads.
fn rate(points: &[Vec3], threads: usize, work: Work<'_>) -> f64 {
    let per_thread = points.len() / threads;
    let run = || {
        let (start, mut rounds) = (Instant::now(), 0);
        while start.elapsed().as_secs_f64() < SECONDS {
            std::thread::scope(|scope| {
                for part in points.chunks(per_thread).skip(1) {
                    scope.spawn(move || (0..ROUNDS).for_each(|_| work(part)));
                }
                (0..ROUNDS).for_each(|_| work(&points[..per_thread]));
            });
            rounds += ROUNDS;
        }
        (rounds * points.len()) as f64 / start.elapsed().as_secs_f64()
    };
    (0..TRIES).map(|_| run()).fold(0.0, f64::max)
}

/// Passes for each start of the threads: the time to start a thread must not count.
const ROUNDS: usize = 8;

/// Measures all passes and prints a table row for each.
pub(crate) fn measure(peak: &Peak) -> Vec<PassResult> {
    let points: Vec<Vec3> = (0..POINTS)
        .map(|i| Vec3::new((i as f32).sin(), (1.3 * i as f32).cos(), 0.2) * 0.7)
        .collect();
    let mut results = Vec::new();
    for (width, layers) in [(64, 3), (64, 4), (256, 8)] {
        let net = network(width, layers);
        let name = format!("{layers} × {width}, 6 octaves");
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
        // The factor is the matrix work in value passes.
        for (pass, factor, work) in passes {
            let (one, two) = (rate(&points, 1, work), rate(&points, 2, work));
            let gflops = one * factor * 2.0 * multiply_adds(width, layers) as f64 / 1e9;
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

/// The number of weights: multiply–adds for each point of a value pass.
fn multiply_adds(width: usize, layers: usize) -> usize {
    FEATURES * width + (layers - 1) * width * width + width
}

const BANDS: usize = 6;
const FEATURES: usize = 3 + 6 * BANDS;

fn network(width: usize, layers: usize) -> Network<f32> {
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: BANDS },
        grid: sdf_nn::SplineSize::none(),
        hidden: vec![width; layers],
        skip: vec![],
        activation: Activation::Softplus { beta: 100.0 },
    };
    Network::geometric(architecture, Transform::default(), 0.5, Stream::of_seed(1))
}
