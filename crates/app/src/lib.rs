//! The application layer of dsdf: everything between files and the layers below, and the `dsdf`
//! command.
//!
//! ```
//! use scene::Scene;
//! use estimate::{Setup, render};
//! use std::path::Path;
//!
//! let scene = serde_json::json!({
//!     "camera": {"width": 8, "height": 8, "focal": 12, "principal": [4, 4], "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
//!     "sdf": {"type": "sphere", "center": [0, 0, 0], "radius": 1},
//!     "appearance": {"type": "normal"},
//!     "background": [0, 0, 0]
//! });
//! let scene = Scene::from_value(Path::new("scene.json"), &scene)?;
//! let field = scene.sdf.build::<f64>()?;
//! let shader = scene.shader::<f64>(&*field)?;
//! let cameras = [scene.camera];
//! let setup = Setup::new(&*field, &*shader, &cameras, &scene.bounds, scene.background.into());
//! let image = render(&setup, 0, 16, 0, &|_| {})?;
//! // The middle of the film sees the side that faces the camera: a normal along +z.
//! assert!(image.film.at(4, 4)[2] > 0.95 && image.coverage[0] == 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cli;
pub mod error;
