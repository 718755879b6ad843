//! The input of a page: a run and its state.

use std::path::Path;

use dataset::Dataset;
use fit::{Model, RunFile};

use crate::verdict::Verdict;

/// A run, with all that its page shows.
#[derive(Debug)]
pub struct Run<'a> {
    /// The folder of the run.
    pub folder: &'a Path,
    /// Its `fit.toml`.
    pub file: &'a RunFile,
    /// Its model.
    pub model: &'a Model,
    /// Its data set, relative to its origin, with the cameras and the exposures as fitted.
    pub dataset: &'a Dataset,
    /// Whether it runs, or its verdict.
    pub state: State<'a>,
    /// The models for the background and the masks, one sentence each.
    pub modelled: &'a [String],
    /// The warnings about its photographs, one sentence each.
    pub warnings: &'a [String],
}

/// The state of a run.
#[derive(Clone, Copy, Debug)]
pub enum State<'a> {
    /// A fit that goes on, with the verdict so far, if it is known.
    Running(Option<&'a Verdict>),
    /// A fit that was stopped before its end.
    Stopped,
    /// A fit that does not run, with the verdict on it.
    Ended(&'a Verdict),
}
