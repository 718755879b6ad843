//! The silhouette estimators by name, and the trait that each of them is.

use std::str::FromStr;

use field::Real;
use serde::{Deserialize, Serialize};

use super::band::Band;
use super::contour::Contour;
use super::convolution::Convolution;
use super::refined::Refined;
use super::warped::{Control, WarpedArea};
use super::{Record, Setup};
use crate::InvalidField;

/// A pixel of one of a setup's cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// The index of the camera.
    pub camera: usize,
    /// The column.
    pub x: u32,
    /// The row.
    pub y: u32,
}

/// What a pixel's value is the mean of radiance by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The pixel's unit square.
    Box,
    /// A Gaussian about the pixel's centre, with a standard deviation of half a pixel.
    Gaussian,
}

/// A way to differentiate pixel values.
///
/// An estimator samples pixels and leaves a [`Record`]: everything that is linear in the pixels'
/// adjoints. Records serve derivative images and parameter gradients alike, so an estimator is
/// written once.
pub trait Estimator<R: Real>: Send + Sync {
    /// Samples pixels. The same pixels and seed give the same bits.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity.
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
    ) -> Result<Record<R>, InvalidField>;

    /// The same with what is known of the pixels, and adds to it.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity.
    fn record_surveyed(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        seed: u64,
        _survey: &mut Survey,
    ) -> Result<Record<R>, InvalidField> {
        self.record(setup, pixels, seed)
    }
}

/// What is known of some pixels from samples before, so that further samples of the same pixels
/// need not find it again.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// Whether a silhouette may cross each; empty before anything is known.
    pub(super) near: Vec<bool>,
}

impl Survey {
    /// A silhouette may cross each of `pixels` pixels.
    pub fn all_near(pixels: usize) -> Self {
        Survey { near: vec![true; pixels] }
    }
}

/// The estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// No silhouette term: what backpropagation through the hit point gives.
    Interior,
    /// As published by Bangaru et al. 2022: top-k warp over the tracer's points, box filter,
    /// pixel-boundary integral.
    Paper,
    /// The same with every point.
    PaperAll,
    /// The same warp under an unbounded Gaussian filter, whose derivative takes the place of the
    /// boundary integral.
    Gaussian,
    /// Bangaru, Li and Durand 2020: the warp is a convolution over auxiliary rays with harmonic
    /// weights.
    Was,
    /// Loubet, Holzschuch and Jakob 2019: samples follow the mean motion of what auxiliary rays
    /// see.
    Loubet,
    /// Wang, Deng, Zhang, Jakob and Marschner 2024: the boundary integral widened to a band around
    /// closest approaches.
    Band,
    /// Ours: silhouettes found along random lines of the film and integrated where they are.
    Refined,
    /// The published one with the weights of a program that extends this one; see docs/extension.
    Custom,
    /// Ground truth: silhouettes traced on a fine grid of the film.
    Contour,
    /// Ground truth: finite differences with common random numbers.
    #[serde(rename = "fd")]
    FiniteDifferences,
}

impl Method {
    /// All, with their names on the command line.
    pub const ALL: [(&'static str, Method); 11] = [
        ("interior", Method::Interior),
        ("paper", Method::Paper),
        ("paper-all", Method::PaperAll),
        ("gaussian", Method::Gaussian),
        ("was", Method::Was),
        ("loubet", Method::Loubet),
        ("band", Method::Band),
        ("refined", Method::Refined),
        ("custom", Method::Custom),
        ("contour", Method::Contour),
        ("fd", Method::FiniteDifferences),
    ];

    /// The names, separated by commas.
    pub fn names() -> String {
        Self::ALL.map(|(name, _)| name).join(", ")
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, method)| *method == self).map_or("", |(name, _)| name)
    }

    /// The filter of the image that is differentiated.
    pub fn filter(self) -> Filter {
        match self {
            Method::Gaussian | Method::Was | Method::Loubet => Filter::Gaussian,
            _ => Filter::Box,
        }
    }

    /// The estimator with a number of samples a pixel and on each edge between pixels; `None` for
    /// finite differences, which need the scene and not the field alone.
    pub fn estimator<R: Real>(
        self,
        spp: u32,
        edge_samples: u32,
        control: Control,
    ) -> Option<Box<dyn Estimator<R>>> {
        let own_weights = self == Method::Custom;
        let warped = |filter, silhouettes, all_points| {
            Box::new(WarpedArea {
                spp,
                edge_samples,
                filter,
                silhouettes,
                all_points,
                own_weights,
                control,
            })
        };
        Some(match self {
            Method::Interior => warped(Filter::Box, false, false),
            Method::Paper | Method::Custom => warped(Filter::Box, true, false),
            Method::PaperAll => warped(Filter::Box, true, true),
            Method::Gaussian => warped(Filter::Gaussian, true, false),
            Method::Was => Box::new(Convolution::harmonic(spp)),
            Method::Loubet => Box::new(Convolution::mean(spp)),
            Method::Band => Box::new(Band { spp }),
            Method::Refined => Box::new(Refined { spp, lines: edge_samples }),
            Method::Contour => Box::new(Contour::new(spp)),
            Method::FiniteDifferences => return None,
        })
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found.map(|(_, method)| *method).ok_or_else(|| format!("one of {}", Self::names()))
    }
}
