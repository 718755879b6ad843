//! The backgrounds of the kinds, and the photographs before them.

use film::{Film, srgb_decode, srgb_encode};
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

/// The wavelengths of the tint of a turntable's backdrop, in shorter sides of the film.
const TINT: [f64; 2] = [2.0, 0.2];

/// The share of the tint in the backdrop of a turntable.
const TINT_SHARE: f32 = 0.35;

/// The sides of the shelves, of the books and of the fields of the table, in shorter sides of the
/// film, and the height at which the table begins.
const SHELF: f64 = 0.23;
const BOOK: f64 = 0.055;
const FIELD: f64 = 0.08;
const TABLE: f64 = 0.7;

/// The largest change of the exposure of a turntable's view: a tenth, in stops.
const SMALL_STOPS: f64 = 0.1375;

/// The standard deviation of a turntable's noise, in display units.
const NOISE_DEVIATION: f64 = 0.01;

const PANORAMA_WAVES: Name = Name::new("waves of a panorama", 1 << 32 | 0xc000);
const NOISE_WAVES: Name = Name::new("waves of a noise picture", 1 << 32 | 0xc001);
const EXPOSURES: Name = Name::new("exposure of a view", 1 << 32 | 0xc002);
const BOOKS: Name = Name::new("colour of a book", 1 << 32 | 0xc004);
const PIXEL_NOISE: Name = Name::new("noise of a pixel", 1 << 32 | 0xc005);
const COLORS: Name = Name::new("colour behind a view", 1 << 32 | 0xc003);

/// The backgrounds of all views of a variant.
pub(super) struct Backdrop {
    kind: Kind,
    stream: Stream,
    /// The environment of [`Kind::Panorama`], or the tint of [`Kind::Turntable`].
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
    /// The same picture in all views.
    Still,
    /// The same picture, with the exposure in stops and the noise of the view.
    NoisyStill(f64, Stream),
    /// A colour, linear RGB.
    Color([f32; 3]),
}

impl Setting {
    /// The entry of a view in the record of the data set.
    pub(super) fn record(&self, file: &str) -> Value {
        match self {
            Setting::Shared | Setting::Still | Setting::Noise(_) => json!({"file": file}),
            Setting::GreyExposure(stops) | Setting::NoisyStill(stops, _) => {
                json!({"file": file, "stops": stops})
            }
            Setting::Color(color) => json!({"file": file, "background": color}),
        }
    }
}

impl Backdrop {
    pub(super) fn new(kind: Kind, seed: u64) -> Self {
        let stream = Stream::of_seed(seed);
        let waves = stream.named(PANORAMA_WAVES);
        let panorama = match kind {
            Kind::Panorama => {
                Some(Texture::new(waves, PANORAMA.map(f64::to_radians), PANORAMA_SMOOTHNESS))
            }
            Kind::Turntable | Kind::TurntableNoise => Some(Texture::new(waves, TINT, 0.0)),
            _ => None,
        };
        Backdrop { kind, stream, panorama }
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
            Kind::Turntable => Setting::Still,
            Kind::TurntableNoise => {
                let stops = SMALL_STOPS * (2.0 * stream(EXPOSURES).unit() - 1.0);
                Setting::NoisyStill(stops, stream(PIXEL_NOISE))
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
            Setting::GreyExposure(stops) | Setting::NoisyStill(stops, _) => stops.exp2() as f32,
            _ => 1.0,
        };
        let pixel = |(i, (object, a)): (usize, (&[f32; 3], &f32))| {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let u = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let behind = if *a < 1.0 { self.radiance(setting, camera, u) } else { [0.0; 3] };
            let shown = [0, 1, 2].map(|c| gain * (object[c] + (1.0 - a) * behind[c]));
            match setting {
                Setting::NoisyStill(_, stream) => noisy(shown, stream.at(i as u64)),
                _ => shown,
            }
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
            Setting::Still | Setting::NoisyStill(..) => {
                let tint = self.panorama.as_ref();
                let place = u / f64::from(camera.width.min(camera.height));
                let tint = tint.map_or([0.5; 3], |tint| tint.at(DVec3::new(place.x, place.y, 0.0)));
                let own = clutter(place, self.stream.named(BOOKS));
                let mixed = |c: usize| TINT_SHARE * tint[c] + (1.0 - TINT_SHARE) * own[c];
                [0, 1, 2].map(mixed).map(srgb_decode)
            }
            Setting::Color(color) => *color,
        }
    }
}

/// A shelf of books above a chequered table, as display values. `u` is in shorter sides of the film.
fn clutter(u: DVec2, stream: Stream) -> [f32; 3] {
    if u.y > TABLE {
        let field = (u / FIELD).floor();
        let is_light = (field.x + field.y).rem_euclid(2.0) < 1.0;
        return if is_light { [0.85, 0.82, 0.7] } else { [0.25, 0.3, 0.45] };
    }
    let shelf = (u.y / SHELF).floor();
    let height = u.y / SHELF - shelf;
    if height > 0.9 {
        return [0.35, 0.22, 0.12];
    }
    let stream = stream.at(shelf as u64).at((u.x / BOOK) as u64);
    let color = [0, 1, 2].map(|c| 0.1 + 0.8 * stream.at(c).unit() as f32);
    // The light falls off towards the lower edge of a shelf.
    let light = 1.0 - 0.3 * height as f32;
    color.map(|v| v * light)
}

/// Linear RGB with noise: a sum of uniform numbers, nearly normal, in display units.
fn noisy(rgb: [f32; 3], stream: Stream) -> [f32; 3] {
    let normal = |c: u64| {
        let sum: f64 = (0..12).map(|i| stream.at(c).at(i).unit()).sum();
        sum - 6.0
    };
    [0, 1, 2].map(|c| {
        let shown = f64::from(srgb_encode(rgb[c])) + NOISE_DEVIATION * normal(c as u64);
        srgb_decode(shown.clamp(0.0, 1.0) as f32)
    })
}
