//! The crates of dsdf and the types that most programs need, for `use app::prelude::*`.

pub use ::{
    boundary, dataset, estimate, field, film, fit, glam, io, mesh, metrics, optim, random, render,
    scene, sdf_nn, trace, warp,
};

pub use ::estimate::{Direction, Estimator, Refined, Registry, SampleCounts, Sampling};
pub use ::estimate::{differentiate, target_gradient};
pub use ::field::{Field, Real, Sphere};
pub use ::film::Film;
pub use ::io::InputError;
pub use ::render::{Camera, Scene, Shader};
pub use ::scene::SceneFile;
