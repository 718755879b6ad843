//! The files of a run folder.

use std::path::{Path, PathBuf};

/// The folder of a run, with the path of each of its files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// The names of the subfolders that a fit needs: of the checkpoint, and of previews.
    pub const SUBFOLDERS: [&str; 2] = ["checkpoint", "preview"];

    /// The run folder at this path.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        RunFolder(path.into())
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The input of the run and its options; see [`RunFile`](crate::RunFile).
    pub fn fit_toml(&self) -> PathBuf {
        self.0.join("fit.toml")
    }

    /// The signed distance network.
    pub fn model(&self) -> PathBuf {
        self.0.join("model.safetensors")
    }

    /// The radiance head.
    pub fn radiance(&self) -> PathBuf {
        self.0.join("radiance.safetensors")
    }

    /// The trained background, if the run has one.
    pub fn background(&self) -> PathBuf {
        self.0.join("background.safetensors")
    }

    /// The refined cameras, if the run has some; see [`RunCameras`](crate::RunCameras).
    pub fn cameras(&self) -> PathBuf {
        self.0.join("cameras.json")
    }

    /// The fitted exposures, if the run has some; see [`RunExposures`](crate::RunExposures).
    pub fn exposures(&self) -> PathBuf {
        self.0.join("exposures.json")
    }

    /// The metrics, one line for each iteration; see [`Metrics`](crate::Metrics).
    pub fn metrics(&self) -> PathBuf {
        self.0.join("metrics.jsonl")
    }

    /// The paths of [`SUBFOLDERS`](Self::SUBFOLDERS).
    pub fn subfolders(&self) -> [PathBuf; 2] {
        Self::SUBFOLDERS.map(|name| self.0.join(name))
    }

    /// The state between two iterations; see [`State`](crate::checkpoint::State).
    pub fn checkpoint(&self) -> PathBuf {
        self.subfolders()[0].join("state.safetensors")
    }

    /// The preview after an iteration.
    pub fn preview(&self, iteration: u64) -> PathBuf {
        self.subfolders()[1].join(format!("{iteration:06}.png"))
    }

    /// The page of the run.
    pub fn page(&self) -> PathBuf {
        self.0.join("report.html")
    }

    /// The file that a running fit locks.
    pub fn lock(&self) -> PathBuf {
        self.0.join("lock")
    }

    /// The files that a fit writes with each checkpoint, beside the checkpoint.
    pub fn results(&self) -> [PathBuf; 5] {
        [self.model(), self.radiance(), self.background(), self.cameras(), self.exposures()]
    }
}
