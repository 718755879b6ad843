//! The spread of the exposures of photographs.

use crate::BackgroundEstimate;
use dataset::View;
use field::Sphere;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::Serialize;

/// The spread of the exposures of a set of photographs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Exposure {
    /// A robust standard deviation of log₂ of the exposure, in stops.
    pub stops: f64,
    /// The pixels that it was measured on.
    pub from: ExposureSource,
}

/// The pixels that an exposure is measured on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureSource {
    /// The background: a uniform one, or one that stands still in the image.
    Background,
    /// The image of the bounding sphere.
    Sphere,
}

/// The least luminance (linear) of a background on which exposures are measured: a black one is
/// black at any exposure. 0.02 is 0.15 in display space.
const LEAST_LUMINANCE: f64 = 0.02;

/// The luminance that counts for a view with a darker background: a logarithm of 0 is infinite.
const DARKEST: f64 = LEAST_LUMINANCE / 16.0;

/// The least number of views whose brightness is compared by their images of the sphere: twice the
/// number of terms of [`directional_terms`].
const LEAST_VIEWS: usize = 18;

/// The share of a column's squared length that must be left for it to count as independent.
const INDEPENDENT: f64 = 1e-6;

/// The median absolute deviation of a normal distribution, in standard deviations.
const MAD_PER_SIGMA: f64 = 0.6745;

/// Pixels sampled in each view, about.
const SAMPLES: f64 = 4096.0;

/// The spread of exposures, in stops, above which a warning is given.
///
/// Measured by the sphere's image: 0.05 for `spot`, 0.07 for `ridged`, 0.07 for DTU scan 65, 0.05
/// for a cow in a room, and 0.21 for the same views with exposures of a true spread of 0.19. By the
/// background: 0 for `bob`.
pub const MOST_SPREAD: f64 = 0.12;

/// The spread of the exposures of `views`; `None` if they do not show it.
///
/// Before a uniform background that is not black, this is the spread of the background's luminance,
/// if its hue is the same in all views.
/// Else it is the spread of the mean luminance inside the sphere's image, without the part that
/// varies smoothly with the direction of the camera. This part is a polynomial of degree 2 in the
/// direction: the light that a diffuse surface reflects is nearly one (Ramamoorthi and Hanrahan,
/// "An Efficient Representation for Irradiance Environment Maps", SIGGRAPH 2001). It needs at least
/// 18 views. What is left holds textures and shadows too, so it is above 0 for equal exposures.
pub fn exposure_spread(
    views: &[View],
    bounds: &Sphere<f64>,
    background: &BackgroundEstimate,
) -> Option<Exposure> {
    let is_uniform = background.is_uniform();
    let of_view = |view| BackgroundEstimate::of_view(view, bounds);
    let backgrounds: Vec<BackgroundEstimate> =
        if is_uniform { views.par_iter().map(of_view).collect() } else { Vec::new() };
    if is_uniform && luminance(background.color) >= LEAST_LUMINANCE && views.len() > 1 {
        let brightness = |color| luminance(color).max(DARKEST).log2();
        let stops: Vec<f64> = backgrounds.iter().map(|b| brightness(b.color)).collect();
        if same_hue(&backgrounds) {
            return Some(Exposure { stops: deviation(&stops), from: ExposureSource::Background });
        }
    }
    let measured: Vec<Option<(DVec3, f64)>> = views
        .par_iter()
        .enumerate()
        .map(|(number, view)| {
            let probability = backgrounds.get(number).map(BackgroundEstimate::probabilities);
            let is_object = |rgb| probability.as_ref().is_none_or(|of| of(rgb) < 0.5);
            brightness_in(view, bounds, &is_object)
        })
        .collect();
    let (directions, mut stops): (Vec<DVec3>, Vec<f64>) = measured.into_iter().flatten().unzip();
    if stops.len() < LEAST_VIEWS {
        return None;
    }
    let removed = remove_part(directional_terms(&directions), &mut stops);
    // Fitted terms take a part of the deviations with them.
    let left = stops.len() as f64 / (stops.len() - removed) as f64;
    let stops = deviation(&stops) * left.sqrt();
    Some(Exposure { stops, from: ExposureSource::Sphere })
}

/// Whether the exposures of `views` differ visibly: a fit then has one for each, and a warning is
/// given where it does not.
pub fn exposures_differ(
    views: &[View],
    bounds: &Sphere<f64>,
    background: &BackgroundEstimate,
) -> bool {
    exposure_spread(views, bounds, background).is_some_and(|found| found.stops > MOST_SPREAD)
}

/// Whether backgrounds differ in brightness only: an exposure changes all channels by one factor.
fn same_hue(backgrounds: &[BackgroundEstimate]) -> bool {
    let channel = |b: &BackgroundEstimate, c: usize| f64::from(b.color[c]).max(DARKEST).log2();
    [0, 2].into_iter().all(|c| {
        let ratios: Vec<f64> = backgrounds.iter().map(|b| channel(b, c) - channel(b, 1)).collect();
        deviation(&ratios) < MOST_SPREAD
    })
}

/// The luminance of linear RGB, by ITU-R BT.709.
fn luminance([r, g, b]: [f32; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

/// A robust standard deviation: by the median absolute deviation from the median.
fn deviation(values: &[f64]) -> f64 {
    let middle = median(values.to_vec());
    median(values.iter().map(|v| (v - middle).abs()).collect()) / MAD_PER_SIGMA
}

/// The median; of an even number of values, the mean of the middle two.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = ((values.len() - 1) / 2, values.len() / 2);
    0.5 * (values[low] + values[high])
}

/// The unit direction of a camera from the sphere's centre, and log₂ of the mean luminance inside
/// the image of the sphere, over pixels that `is_object` accepts. `None` if that is black, or
/// outside the film.
fn brightness_in(
    view: &View,
    bounds: &Sphere<f64>,
    is_object: &impl Fn([f32; 3]) -> bool,
) -> Option<(DVec3, f64)> {
    let (width, height) = (view.image.width, view.image.height);
    let stride = (f64::from(width) * f64::from(height) / SAMPLES).sqrt().ceil().max(1.0) as usize;
    let (mut sum, mut count) = (0.0, 0);
    for y in (0..height).step_by(stride) {
        for x in (0..width).step_by(stride) {
            let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let rgb = view.image.at(x, y);
            let direction = view.camera.direction(u);
            let is_used = view.is_used((y * width + x) as usize);
            if is_used && is_object(rgb) && bounds.clip(view.camera.eye, direction).is_some() {
                sum += luminance(rgb);
                count += 1;
            }
        }
    }
    let stops = (sum / f64::from(count)).log2();
    let direction = (view.camera.eye - bounds.center).normalize_or_zero();
    stops.is_finite().then_some((direction, stops))
}

/// The polynomials of degree 2 in a unit direction, one column each. (z² = 1 − x² − y² is none of
/// its own.)
fn directional_terms(directions: &[DVec3]) -> Vec<Vec<f64>> {
    let terms: [fn(DVec3) -> f64; 9] = [
        |_| 1.0,
        |d| d.x,
        |d| d.y,
        |d| d.z,
        |d| d.x * d.y,
        |d| d.y * d.z,
        |d| d.z * d.x,
        |d| d.x * d.x,
        |d| d.y * d.y,
    ];
    terms.iter().map(|term| directions.iter().map(|d| term(*d)).collect()).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Subtracts the least-squares fit by `columns` from `values`, by the modified Gram–Schmidt
/// process. Returns the number of independent columns: cameras on a circle make some dependent.
fn remove_part(columns: Vec<Vec<f64>>, values: &mut [f64]) -> usize {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        let length = dot(&column, &column);
        basis.iter().for_each(|unit| subtract_along(unit, &mut column));
        let left = dot(&column, &column);
        if left > INDEPENDENT * length {
            column.iter_mut().for_each(|v| *v /= left.sqrt());
            subtract_along(&column, values);
            basis.push(column);
        }
    }
    basis.len()
}

/// Subtracts from `vector` its part along the unit vector `unit`.
fn subtract_along(unit: &[f64], vector: &mut [f64]) {
    let along = dot(unit, vector);
    vector.iter_mut().zip(unit).for_each(|(v, u)| *v -= along * u);
}

#[cfg(test)]
#[path = "exposure_tests.rs"]
mod tests;
