#![doc = include_str!("../README.md")]

mod derivative;
mod dip;
mod intersect;
mod intersection;
mod lattice;
mod march;
mod options;
mod point;
mod ray;
mod root;
mod silhouette;
mod visit;

pub use derivative::{HitAdjoint, entry_derivative, exit_derivative, hit_film_derivative, hit_vjp};
pub use field;
pub use intersect::{intersect, intersect_rows};
pub use intersection::{Intersection, Outcome};
pub use lattice::Lattice;
pub use options::Options;
pub use ray::Ray;
pub use silhouette::{RayFamily, Start, Tangency, tangencies};
pub use visit::{Visited, Visits, visit};
