//! Backdrops whose colour changes smoothly over a photograph: a gradient of light, a vignette.

use field::Sphere;
use film::srgb_encode;
use glam::DVec2;

use crate::background::{LEAST_SPREAD, deviation, reach, surrounding_places};
use dataset::View;

/// The number of terms of a polynomial of degree 2 in two variables.
const TERMS: usize = 6;

/// Fits of the polynomial: each leaves out the pixels that the last did not explain.
const FITS: usize = 6;

/// The least share of the surrounding pixels that the polynomial must explain.
const LEAST_SHARE: f64 = 0.9;

/// The largest spread of a smooth backdrop, in display units.
const MOST_SPREAD: f32 = 0.03;

/// The colour of a backdrop over one photograph, in display space: a polynomial of degree 2 in the
/// place on the film, for each channel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Backdrop {
    coefficients: [[f64; TERMS]; 3],
    /// The standard deviation of its pixels, the largest of the channels.
    spread: f32,
    size: DVec2,
}

/// A place on the film with its colour in display space.
type Sample = ([f64; TERMS], [f32; 3]);

impl Backdrop {
    /// Fits the backdrop of a view to the pixels whose rays miss the sphere `candidate`, and to
    /// those of the border. `None` if it explains less than 90 % of them, or not well.
    pub(crate) fn of_view(view: &View, candidate: &Sphere<f64>) -> Option<Self> {
        let size = DVec2::new(f64::from(view.image.width), f64::from(view.image.height));
        let sample = |(x, y): (u32, u32)| -> Sample {
            (terms(x, y, size), view.image.at(x, y).map(srgb_encode))
        };
        let is_used = |(x, y): &(u32, u32)| view.is_used((y * view.image.width + x) as usize);
        let places = surrounding_places(view, candidate).into_iter().filter(is_used);
        let all: Vec<Sample> = places.map(sample).collect();
        if all.len() < 4 * TERMS {
            return None;
        }
        let mut found = Backdrop::around(&all, size);
        let mut near = Vec::new();
        for _ in 0..FITS {
            let is_near = |(terms, color): &&Sample| found.distance(terms, *color) < found.reach();
            near = all.iter().filter(is_near).copied().collect::<Vec<Sample>>();
            if near.len() < all.len() / 2 {
                return None;
            }
            found = Backdrop::around(&near, size);
        }
        let explained = near.len() as f64 >= LEAST_SHARE * all.len() as f64;
        (explained && found.spread <= MOST_SPREAD).then_some(found)
    }

    /// The polynomial of least squares, and the spread around it.
    fn around(samples: &[Sample], size: DVec2) -> Self {
        let coefficients = [0, 1, 2].map(|c| least_squares(samples, c));
        let mut found = Backdrop { coefficients, spread: LEAST_SPREAD, size };
        let residual = |(terms, color): &Sample| {
            let own = found.color(terms);
            [0, 1, 2].map(|c| color[c] - own[c])
        };
        let residuals: Vec<[f32; 3]> = samples.iter().map(residual).collect();
        found.spread = deviation(&residuals, [0.0; 3]);
        found
    }

    fn color(&self, terms: &[f64; TERMS]) -> [f32; 3] {
        let of = |own: [f64; TERMS]| own.iter().zip(terms).map(|(a, b)| a * b).sum::<f64>() as f32;
        self.coefficients.map(of)
    }

    /// The largest distance of the channels.
    fn distance(&self, terms: &[f64; TERMS], color: [f32; 3]) -> f32 {
        let own = self.color(terms);
        (0..3).map(|c| (color[c] - own[c]).abs()).fold(0.0, f32::max)
    }

    fn reach(&self) -> f32 {
        reach(self.spread)
    }

    /// Whether pixel `i` of the view, row-major, of this linear RGB shows something else.
    pub(crate) fn is_hidden_at(&self, i: usize, rgb: [f32; 3]) -> bool {
        let width = self.size.x as usize;
        let terms = terms((i % width) as u32, (i / width) as u32, self.size);
        self.distance(&terms, rgb.map(srgb_encode)) >= self.reach()
    }
}

/// The terms of the polynomial at the middle of a pixel, with x and y from −1 to 1 over the film.
fn terms(x: u32, y: u32, size: DVec2) -> [f64; TERMS] {
    let DVec2 { x, y } = 2.0 * (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / size - 1.0;
    [1.0, x, y, x * x, x * y, y * y]
}

/// The coefficients of least squares for a channel: the normal equations by conjugate gradients,
/// which need as many steps as there are unknowns.
fn least_squares(samples: &[Sample], channel: usize) -> [f64; TERMS] {
    let (mut matrix, mut rest) = ([[0.0; TERMS]; TERMS], [0.0; TERMS]);
    for (terms, color) in samples {
        for i in 0..TERMS {
            (0..TERMS).for_each(|j| matrix[i][j] += terms[i] * terms[j]);
            rest[i] += terms[i] * f64::from(color[channel]);
        }
    }
    let dot = |a: &[f64; TERMS], b: &[f64; TERMS]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (mut found, mut direction) = ([0.0; TERMS], rest);
    for _ in 0..2 * TERMS {
        let along = matrix.map(|row| dot(&row, &direction));
        let (square, curvature) = (dot(&rest, &rest), dot(&direction, &along));
        if square <= 0.0 || curvature <= 0.0 {
            break;
        }
        let step = square / curvature;
        for i in 0..TERMS {
            found[i] += step * direction[i];
            rest[i] -= step * along[i];
        }
        let turn = dot(&rest, &rest) / square;
        (0..TERMS).for_each(|i| direction[i] = rest[i] + turn * direction[i]);
    }
    found
}
