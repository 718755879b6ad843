//! The backgrounds of the kinds, and the photographs before them.

use film::{Film, srgb_decode};
use glam::{DVec2, DVec3};
use random::{Name, Stream};
use render::Camera;
use serde_json::{Value, json};

use super::kind::Kind;
use super::source::Layers;
use super::texture::Texture;

/// The wavelengths of the panorama, degrees: longest and shortest.
const PANORAMA: [f64; 2] = [40.0, 1.0];

/// The exponent by which the contrast of the panorama falls with the wavelength: a wave of 1 degree
/// has a sixth of the contrast of one of 40 degrees.
const PANORAMA_SMOOTHNESS: f64 = 0.5;

/// The wavelengths of a noise picture, in shorter sides of the film: longest and shortest.
const NOISE: [f64; 2] = [0.5, 1.0 / 64.0];

/// The radiance of the mid-grey, in every channel: the 18 % of photographers' grey cards.
const GREY: f32 = 0.18;

/// The largest change of the exposure, stops.
const MOST_STOPS: f64 = 0.7;

const PANORAMA_WAVES: Name = Name::new("waves of a panorama", 1 << 32 | 0xc000);
const NOISE_WAVES: Name = Name::new("waves of a noise picture", 1 << 32 | 0xc001);
const EXPOSURES: Name = Name::new("exposure of a view", 1 << 32 | 0xc002);
const COLORS: Name = Name::new("colour behind a view", 1 << 32 | 0xc003);

/// The backgrounds of all views of a variant.
pub(super) struct Backdrop {
    kind: Kind,
    stream: Stream,
    /// The environment of [`Kind::Panorama`].
    panorama: Option<Texture>,
}

/// The random part of one view.
pub(super) enum Setting {
    /// Nothing: all views have the same background.
    Shared,
    /// The view's own noise picture.
    Noise(Texture),
    /// Mid-grey, and the exposure in stops.
    GreyExposure(f64),
    /// A colour, linear RGB.
    Color([f32; 3]),
}

impl Setting {
    /// The entry of a view in the record of the data set.
    pub(super) fn record(&self, file: &str) -> Value {
        match self {
            Setting::Shared | Setting::Noise(_) => json!({"file": file}),
            Setting::GreyExposure(stops) => json!({"file": file, "stops": stops}),
            Setting::Color(color) => json!({"file": file, "background": color}),
        }
    }
}

impl Backdrop {
    pub(super) fn new(kind: Kind, seed: u64) -> Self {
        let stream = Stream::of_seed(seed);
        let waves = stream.named(PANORAMA_WAVES);
        let panorama = || Texture::new(waves, PANORAMA.map(f64::to_radians), PANORAMA_SMOOTHNESS);
        Backdrop { kind, stream, panorama: (kind == Kind::Panorama).then(panorama) }
    }

    /// The random part of view `i` of a set; the number of the set is 0 for training views and 1
    /// for held-out views.
    pub(super) fn setting(&self, set: usize, i: usize) -> Setting {
        let stream = |name| self.stream.named(name).at(set as u64).at(i as u64);
        match self.kind {
            Kind::Panorama | Kind::Alpha | Kind::Black => Setting::Shared,
            Kind::Noise => Setting::Noise(Texture::new(stream(NOISE_WAVES), NOISE, 0.0)),
            Kind::GreyExposure => {
                Setting::GreyExposure(MOST_STOPS * (2.0 * stream(EXPOSURES).unit() - 1.0))
            }
            Kind::PerView => {
                let display = |c| stream(COLORS).at(c).unit() as f32;
                Setting::Color([0, 1, 2].map(display).map(srgb_decode))
            }
        }
    }

    /// The photograph of the object in front of the background, linear RGB.
    pub(super) fn photograph(&self, setting: &Setting, camera: &Camera, layers: &Layers) -> Film {
        let Layers { width, height, object, coverage } = layers;
        let gain = match setting {
            Setting::GreyExposure(stops) => stops.exp2() as f32,
            _ => 1.0,
        };
        let pixel = |(i, (object, a)): (usize, (&[f32; 3], &f32))| {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let u = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let behind = if *a < 1.0 { self.radiance(setting, camera, u) } else { [0.0; 3] };
            std::array::from_fn(|c| gain * (object[c] + (1.0 - a) * behind[c]))
        };
        let pixels = object.iter().zip(coverage).enumerate().map(pixel).collect();
        Film { width: *width, height: *height, pixels }
    }

    /// The radiance of the background at the film position `u`, linear RGB.
    fn radiance(&self, setting: &Setting, camera: &Camera, u: DVec2) -> [f32; 3] {
        match setting {
            Setting::Shared => match &self.panorama {
                Some(panorama) => panorama.at(camera.direction(u)).map(srgb_decode),
                None => [0.0; 3],
            },
            Setting::Noise(texture) => {
                let side = f64::from(camera.width.min(camera.height));
                texture.at(DVec3::new(u.x, u.y, 0.0) / side).map(srgb_decode)
            }
            Setting::GreyExposure(_) => [GREY; 3],
            Setting::Color(color) => *color,
        }
    }
}
