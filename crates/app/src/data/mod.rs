//! Data sets of posed photographs.

use std::path::PathBuf;

use field::Sphere;

use crate::camera::Camera;
use crate::film::Film;

/// One posed photograph.
#[derive(Clone, Debug)]
pub struct View {
    /// The image's name in the data set, for messages and pictures.
    pub name: String,
    /// The image's file.
    pub path: PathBuf,
    /// The camera it was taken with.
    pub camera: Camera,
    /// The photograph, linear RGB. An alpha channel is not applied: it is kept in `mask`.
    pub image: Film,
    /// Coverage in [0, 1] per pixel from an alpha channel or a mask folder, where there is one; row-major.
    pub mask: Option<Vec<f32>>,
}

/// A data set as dsdf understood it.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder.
    pub path: PathBuf,
    /// The format and convention that were recognised, for people.
    pub format: String,
    /// Views to fit.
    pub train: Vec<View>,
    /// Held-out views, for evaluation only.
    pub test: Vec<View>,
    /// The bounding sphere, if the data set says (NeuS/IDR `scale_mat`).
    pub bounds: Option<Sphere<f64>>,
}
