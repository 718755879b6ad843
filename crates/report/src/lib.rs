#![doc = include_str!("../README.md")]

mod accuracy;
mod curves;
mod detail;
mod error;
mod escape;
mod examine;
mod page;
mod run;
mod solid;
mod surface;
mod tables;
mod verdict;
mod views;

pub use accuracy::sampled_psnr;
pub use detail::Detail;
pub use error::Error;
pub use examine::{examine, modelled};
pub use page::{Content, live_page};
pub use run::{Run, State};
pub use surface::{SurfaceShares, surface_shares};
pub use verdict::{Evidence, Fault, Verdict};
