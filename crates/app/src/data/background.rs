//! What the background looks like, from the photographs alone.

use field::Sphere;
use glam::DVec2;

use super::View;
use crate::film::{srgb_decode, srgb_encode};

/// A uniform background, as far as there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Its linear RGB.
    pub color: [f32; 3],
    /// The robust standard deviation of its pixels in display space, the largest of the channels.
    pub spread: f32,
    /// How uniform it is: 0 for clutter, 1 where nearly all pixels around the object look alike.
    pub confidence: f32,
}

/// The smallest spread that is believed, in display units: two steps of 8 bits, the noise of a clean render.
const LEAST_SPREAD: f32 = 2.0 / 255.0;

/// Pixels within this many spreads (of at least twice the least) count as background.
const NEAR: f32 = 4.0;

/// The median absolute deviation of a normal distribution, per standard deviation.
const MAD_PER_SIGMA: f32 = 0.6745;

impl Background {
    /// Estimates the background from the pixels whose rays miss `candidate`, and those on the images' borders.
    pub fn estimate(views: &[View], candidate: &Sphere<f64>) -> Self {
        let pixels: Vec<[f32; 3]> = views.iter().flat_map(|view| surrounding_pixels(view, candidate)).collect();
        if pixels.is_empty() {
            return Background { color: [0.0; 3], spread: LEAST_SPREAD, confidence: 0.0 };
        }
        let center: [f32; 3] = std::array::from_fn(|c| median(pixels.iter().map(|p| p[c]).collect()));
        let spread = (0..3)
            .map(|c| median(pixels.iter().map(|p| (p[c] - center[c]).abs()).collect()) / MAD_PER_SIGMA)
            .fold(LEAST_SPREAD, f32::max);
        let reach = NEAR * spread.max(2.0 * LEAST_SPREAD);
        let near = pixels.iter().filter(|p| (0..3).all(|c| (p[c] - center[c]).abs() < reach)).count();
        let share = near as f32 / pixels.len() as f32;
        // Half alike is no background; beyond 90 % the rest is the object touching the frame. A spread of 0.15 is clutter.
        let confidence = ((share - 0.5) / 0.4).clamp(0.0, 1.0) * ((0.15 - spread) / 0.1).clamp(0.0, 1.0);
        Background { color: center.map(srgb_decode), spread, confidence }
    }

    /// The probability that a pixel of this linear colour shows the background: a normal distribution of the spread
    /// against an object of any colour, equally likely beforehand.
    pub fn probability(&self, rgb: [f32; 3]) -> f32 {
        let sigma = self.spread.max(LEAST_SPREAD);
        let square: f32 = (0..3).map(|c| ((srgb_encode(rgb[c]) - srgb_encode(self.color[c])) / sigma).powi(2)).sum();
        let density = (-0.5 * square).exp() / ((2.0 * std::f32::consts::PI).sqrt() * sigma).powi(3);
        density / (density + 1.0)
    }
}

/// Pixels that should show background, in display space: at most a few thousand a view.
fn surrounding_pixels(view: &View, candidate: &Sphere<f64>) -> Vec<[f32; 3]> {
    let (width, height) = (view.image.width, view.image.height);
    let stride = (f64::from(width * height) / 4096.0).sqrt().ceil().max(1.0) as u32;
    let shown = |x: u32, y: u32| view.image.at(x, y).map(srgb_encode);
    let mut pixels = Vec::new();
    for y in (0..height).step_by(stride as usize) {
        for x in (0..width).step_by(stride as usize) {
            let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if candidate.clip(view.camera.eye, view.camera.direction(u)).is_none() {
                pixels.push(shown(x, y));
            }
        }
    }
    for x in (0..width).step_by(stride as usize) {
        pixels.extend([shown(x, 0), shown(x, height - 1)]);
    }
    for y in (0..height).step_by(stride as usize) {
        pixels.extend([shown(0, y), shown(width - 1, y)]);
    }
    pixels
}

fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_backgrounds_own_colour_is_probable_and_others_are_not() {
        let background = Background { color: [0.1, 0.2, 0.3], spread: 0.01, confidence: 1.0 };
        assert!(background.probability([0.1, 0.2, 0.3]) > 0.99);
        assert!(background.probability([0.3, 0.2, 0.1]) < 1e-6);
        assert!(background.probability([0.105, 0.205, 0.3]) > 0.9);
    }
}
