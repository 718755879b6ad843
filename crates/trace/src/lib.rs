//! Batched sphere tracing of signed distance fields.
//!
//! A *ray* is o + t d with |d| = 1, followed over an interval [near, far] of t. The field is read
//! as a distance: positive outside, negative inside. [`intersect`] finds the first crossing from
//! positive to not positive; [`visit`] records the points T(u) of the plain recursion t ← t + ρ f,
//! which warp fields are built on; the functions in this crate's root give the derivative of a hit
//! and of a ray's entry, forward and in reverse.
//!
//! ```
//! use field::{Field, Shape, Sphere};
//! use glam::DVec3;
//! use trace::{Options, Outcome, Ray, intersect};
//!
//! let ball = Shape::<f64>::sphere([0.0; 3], 1.01);
//! let bounds = Sphere { center: DVec3::ZERO, radius: 1.5 };
//! let mut picture = String::new();
//! for row in 0..7 {
//!     let rays: Vec<_> = (0..13)
//!         .map(|column| DVec3::new((f64::from(column) - 6.0) / 5.0, (3.0 - f64::from(row)) / 2.5, 4.0))
//!         .filter_map(|origin| Ray::enter(origin, -DVec3::Z, &bounds))
//!         .collect();
//!     let mut found = Vec::new();
//!     intersect(&ball, &rays, &Options::default(), &mut found);
//!     let mut found = found.iter();
//!     for column in 0..13 {
//!         let origin = DVec3::new((f64::from(column) - 6.0) / 5.0, (3.0 - f64::from(row)) / 2.5, 4.0);
//!         let hit = Ray::enter(origin, -DVec3::Z, &bounds).and(found.next());
//!         picture.push(if hit.is_some_and(|f| f.outcome == Outcome::Hit) { '#' } else { '.' });
//!     }
//!     picture.push('\n');
//! }
//! assert_eq!(picture, "\
//! .............
//! ...#######...
//! ..#########..
//! .###########.
//! ..#########..
//! ...#######...
//! .............
//! ");
//! ```
//!
//! # What is guaranteed
//! Every ray ends, after at most [`Options::step_limit`] evaluations. A hit's f is zero to the
//! tolerance. A grazing ray is decided by the sign of f at its closest approach, not by running out
//! of steps. A NaN ends its ray as [`Outcome::Invalid`].
//!
//! # What is not
//! Where the field is not 1-Lipschitz a step may jump over a thin part. Close to a surface a step
//! follows the slope of the last two values, up to a few times f: a part thinner than that, seen
//! behind a slope that was about to cross, is missed. Parts thinner than [`Options::min_step`] may
//! be missed by rays that graze something else there.

mod derivative;
mod intersect;
mod options;
mod ray;
mod root;
mod silhouette;
mod visit;

pub use derivative::{HitAdjoint, entry_derivative, exit_derivative, hit_film_derivative, hit_vjp};
pub use field;
pub use intersect::{Intersection, Outcome, intersect};
pub use options::{InvalidOptions, Options};
pub use ray::Ray;
pub use silhouette::{RayFamily, Start, Tangency, tangencies};
pub use visit::{Visited, Visits, visit};
