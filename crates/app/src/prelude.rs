//! The crates of dsdf and the types that most programs need, for `use app::prelude::*`.

pub use ::{
    boundary, dataset, estimate, field, film, fit, glam, gradient, io, mesh, metrics, optim,
    random, render, scene, sdf_nn, trace, warp,
};

pub use ::estimate::{Estimator, Refined, Registry, SampleCounts};
pub use ::field::{Field, Real, Sphere};
pub use ::film::Film;
pub use ::gradient::{Direction, Sampling, differentiate, target_gradient};
pub use ::io::InputError;
pub use ::render::{Camera, Scene, Shader};
pub use ::scene::{SceneFile, ScenePrecision};
