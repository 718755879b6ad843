//! The crates of dsdf and the types that most programs need, for `use app::prelude::*`.

pub use crate::{
    boundary, dataset, estimate, export, field, files, film, fit, glam, inspect, loss, mesh,
    metrics, multiview, optim, poses, random, render, report, scene, sdf_nn, trace, warp,
};

pub use ::estimate::gradient::{Direction, Sampling, differentiate, target_gradient};
pub use ::estimate::{Estimator, Refined, Registry, SampleCounts};
pub use ::field::{Field, Real, Shader, Sphere};
pub use ::files::InputError;
pub use ::film::Film;
pub use ::render::{Camera, Scene};
pub use ::scene::{SceneFile, ScenePrecision};
