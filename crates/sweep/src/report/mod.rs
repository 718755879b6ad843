//! The definition of a sweep, its results, and the report on them.

mod claims;
mod compare;
pub mod files;
mod grid;
mod heat_map;
mod html;
mod load;
pub mod metrics;
pub mod options;
mod pairs;
mod plots;
mod recommendation;
mod result_table;
pub mod results;
mod results_csv;
pub mod schema;
mod statistics;
mod sweep;
mod sweep_check;
mod write;

pub use compare::compare;
pub use load::{SHIPPED, absolute, shipped};
pub use sweep::{Cell, Sweep};
pub use write::write_report;
