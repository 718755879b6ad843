//! Smooth random textures: sums of plane waves.

use std::f64::consts::TAU;

use glam::DVec3;
use random::Stream;

/// The waves of a texture.
const WAVES: usize = 96;

/// The standard deviation of the sum of all waves, before it is limited to colours.
const DEVIATION: f64 = 0.6;

/// A random colour as a function of a point, without seams.
///
/// The logarithms of the wavelengths are spread evenly: each octave has as many waves. The
/// directions of the waves are random in space, so a plane or a sphere that cuts them shows some
/// longer ones, and none shorter than the shortest.
pub(super) struct Texture {
    waves: Vec<Wave>,
}

struct Wave {
    /// The direction of the wave times 2π over its length.
    vector: DVec3,
    /// Radians.
    phase: f64,
    amplitude: [f64; 3],
}

impl Texture {
    /// A texture with wavelengths between `longest` and `shortest`, in the units of the points.
    ///
    /// Amplitudes are proportional to the wavelength to the power of `smoothness`: 0 gives all
    /// octaves the same contrast, and larger values give less to the finer ones.
    pub(super) fn new(stream: Stream, [longest, shortest]: [f64; 2], smoothness: f64) -> Self {
        let wave = |i: usize| {
            let number = |n| stream.at(i as u64).at(n).unit();
            let place = (i as f64 + number(0)) / WAVES as f64;
            let length = longest * (shortest / longest).powf(place);
            let direction = DVec3::from(stream.at(i as u64).at(1).in_ball()).normalize_or(DVec3::X);
            let largest = length.powf(smoothness);
            let amplitude = [3, 4, 5].map(|n| largest * (2.0 * number(n) - 1.0));
            Wave { vector: direction * (TAU / length), phase: TAU * number(2), amplitude }
        };
        let mut waves: Vec<Wave> = (0..WAVES).map(wave).collect();
        // The variance of a wave is half of the square of its amplitude.
        let squares: f64 = waves.iter().flat_map(|w| w.amplitude).map(|a| a * a).sum();
        let scale = DEVIATION / (squares / 6.0).sqrt();
        waves.iter_mut().for_each(|wave| wave.amplitude = wave.amplitude.map(|a| scale * a));
        Texture { waves }
    }

    /// The colour at a point, as display values (sRGB) between 0 and 1.
    pub(super) fn at(&self, x: DVec3) -> [f32; 3] {
        let mut sum = DVec3::ZERO;
        for wave in &self.waves {
            sum += DVec3::from(wave.amplitude) * (wave.vector.dot(x) + wave.phase).cos();
        }
        sum.to_array().map(|v| (0.5 + 0.5 * v.tanh()) as f32)
    }
}
