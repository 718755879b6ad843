//! `dsdf scan`: from photographs to a mesh.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::common::{Global, arguments};
use super::fit::{Fit, FitReport, serve_page};
use super::mesh::{Mesh, MeshReport};
use super::poses::Poses;
use crate::serve::{Address, THIS_COMPUTER};
use ::poses::{Photographs, Poses as Found};
use files::{InputError, check_output};
use fit::RunFolder;

/// Arguments of `dsdf scan`.
#[derive(Args, Debug)]
pub(crate) struct Scan {
    /// Folder of photographs (.jpg, .png, .tif, .webp), or a data set with poses
    photos: PathBuf,
    /// Folder to write: dataset/, run/, mesh.glb and report.html
    #[arg(short, long)]
    output: PathBuf,
    /// Wall time of all steps, for example 90 (seconds) or 30m; the fit has what the poses leave
    #[arg(long, default_value = "15m", value_parser = ::files::parse_duration)]
    time: Duration,
    /// The program COLMAP [default: colmap on the search path]
    #[arg(long, value_name = "PROGRAM")]
    colmap: Option<PathBuf>,
    /// Show the scan in a browser while it runs: at a port, or an address
    ///
    /// The page has the progress, the surface, renders beside photographs, the curves, and a button
    /// that stops the fit. Without a value, it is at a free port, for this computer alone.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = THIS_COMPUTER)]
    serve: Option<Address>,
}

/// The time that the mesh and the page get, on one thread; more threads are faster.
const LAST_STEPS: Duration = Duration::from_secs(60);

/// The most threads that this time is divided by.
const MOST_THREADS: usize = 8;

/// The most of the whole time that they get.
const MOST_OF_LAST_STEPS: f64 = 0.3;

/// The least share of the time that the fit gets, however long the poses took.
const LEAST_FIT: f64 = 0.35;

/// The result of `dsdf scan`.
#[derive(Serialize)]
struct ScanReport {
    /// The data set of the fit.
    dataset: PathBuf,
    /// The poses; `None` if the data set had them.
    poses: Option<Found>,
    /// The fit, with its run folder and the verdict.
    fit: FitReport,
    /// The mesh file.
    mesh: PathBuf,
    /// Its size and its cuts.
    shape: MeshReport,
    /// The page.
    page: PathBuf,
    /// Wall time of the command, in seconds.
    seconds: f64,
}

impl ScanReport {
    /// The steps, one line each.
    fn text(&self) -> String {
        let poses = self.poses.as_ref().map_or(String::new(), |poses| {
            let advice = poses.warnings.iter().chain(&poses.advice);
            let advice: String = advice.map(|line| format!("\nadvice       {line}")).collect();
            format!(
                "poses        {} of {} photographs{advice}\n",
                poses.registered, poses.photographs
            )
        });
        format!(
            "{poses}fit          {}\nmesh         {}\npage         {}\n{:.0} s in all",
            self.fit.text(),
            self.shape.text(&self.mesh),
            self.page.display(),
            self.seconds
        )
    }
}

impl Scan {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let start = Instant::now();
        let output = no_flag(&self.output);
        let [run, mesh, page] = ["run", "mesh.glb", "report.html"].map(|name| output.join(name));
        global.will_write_in(&output, &[])?;
        if output.is_dir() {
            check_output(&mesh)?;
            check_output(&page)?;
        }
        let (dataset, poses) = self.posed(&output, &run, global)?;
        let time = self.time_of_fit(start.elapsed());
        global.say(&match RunFolder::new(&run).checkpoint().is_file() {
            true => "step 2 of 3: the surface, in the time of the run that it continues".to_owned(),
            false => format!("step 2 of 3: the surface, {:.0} s", time.as_secs_f64()),
        });
        let fit = Fit::as_step(dataset.clone(), run.clone(), time, page.clone(), global)?;
        global.say("step 3 of 3: the mesh");
        let shape = self.mesh(&run, &mesh, global)?;
        let seconds = start.elapsed().as_secs_f64();
        let report = ScanReport { dataset, poses, fit, mesh, shape, page, seconds };
        global.report(&report, || report.text())
    }

    /// The data set: that of the argument, or the photographs with poses by COLMAP.
    fn posed(
        &self,
        output: &Path,
        run: &Path,
        global: &Global,
    ) -> anyhow::Result<(PathBuf, Option<Found>)> {
        let serve = || self.serve.map_or(Ok(()), |address| serve_page(address, run, global));
        match dataset::open(&self.photos) {
            Ok(_) => {
                serve()?;
                global.say("step 1 of 3: the data set has poses");
                return Ok((self.photos.clone(), None));
            }
            // A data set with an error is no folder of photographs.
            Err(error) if self.photos.exists() && !self.has_no_camera_file(&error) => {
                return Err(error.into());
            }
            Err(_) => {}
        }
        Photographs::in_folder(&self.photos)?;
        serve()?;
        global.say("step 1 of 3: the poses of the photographs");
        let (photos, output) = (no_flag(&self.photos), output.join("dataset"));
        let colmap = self.colmap.as_deref().map(no_flag);
        let program = colmap.iter().flat_map(|path| [OsStr::new("--colmap"), path.as_os_str()]);
        let words = [photos.as_os_str(), OsStr::new("--output"), output.as_os_str()];
        let found = arguments::<Poses>(words.into_iter().chain(program))?.find(global)?;
        Ok((output, Some(found)))
    }

    /// Whether the argument is a folder that is no data set.
    fn has_no_camera_file(&self, error: &InputError) -> bool {
        self.photos.is_dir() && error.file == self.photos && error.field == "data set"
    }

    /// The time that the fit gets when the poses have taken theirs.
    fn time_of_fit(&self, taken: Duration) -> Duration {
        let threads = rayon::current_num_threads().min(MOST_THREADS) as u32;
        let last = (LAST_STEPS / threads).min(self.time.mul_f64(MOST_OF_LAST_STEPS));
        self.time.saturating_sub(taken + last).max(self.time.mul_f64(LEAST_FIT))
    }

    /// Writes the mesh of what photographs show, without the table.
    fn mesh(&self, run: &Path, mesh: &Path, global: &Global) -> anyhow::Result<MeshReport> {
        let cuts = ["--cull", "seen", "--above", "auto"].map(OsStr::new);
        let words = [run.as_os_str(), OsStr::new("--output"), mesh.as_os_str()];
        let mut mesh: Mesh = arguments(words.into_iter().chain(cuts))?;
        mesh.cut.is_lenient = true;
        mesh.write(global)
    }
}

/// A path that is no flag on a command line.
fn no_flag(path: &Path) -> PathBuf {
    let is_flag = path.as_os_str().as_encoded_bytes().starts_with(b"-");
    if is_flag { Path::new(".").join(path) } else { path.to_owned() }
}
