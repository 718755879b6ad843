//! Checks of the warp against an independent implementation, in double precision.

#![allow(clippy::needless_range_loop, reason = "film axes and points go in step: an index says so")]

mod batches;
mod continuity;
mod derivatives;
mod lemmas;
mod poison;
mod reference;
mod reverse;
mod scene;
mod silhouette;
