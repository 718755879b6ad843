//! The readers of dsdf, each with its generator.

use std::path::Path;

use anyhow::Context;
use dataset::{Dataset, LoadOptions, View};
use estimate::Registry;
use film::Film;
use film::{image_size, read_image, read_npy};
use fit::{Model, RunFile, Session};
use glam::{DVec2, DVec3};
use mesh::{read_mesh, read_points};
use proptest::strategy::BoxedStrategy;
use render::Camera;
use scene::SceneFile;
use sweep::report::{Sweep, compare};

use crate::case::{Case, damaged};
use crate::formats::{
    arrays, datasets, forms, images, meshes, models, runs, scenes, solids, sweeps,
};
use crate::program::judge_command;
use crate::self_test;
use crate::verdict::{Verdict, judge};

/// How a reader is called.
#[derive(Clone, Copy, Debug)]
enum Call {
    /// A function of a library, on the folder of a case.
    Library(fn(&Path) -> anyhow::Result<()>),
    /// A command of `dsdf`, in the folder of a case.
    Command(&'static [&'static str]),
}

/// A reader with the generator of its files.
#[derive(Debug)]
pub struct Reader {
    /// The name on the command line.
    pub name: &'static str,
    strategy: fn() -> BoxedStrategy<Case>,
    call: Call,
}

impl Reader {
    /// The generator of cases.
    pub(crate) fn strategy(&self) -> BoxedStrategy<Case> {
        (self.strategy)()
    }

    /// Reads the files of a folder, and judges the result.
    ///
    /// # Errors
    /// If a command cannot be started.
    pub fn read(&self, folder: &Path) -> anyhow::Result<Verdict> {
        match self.call {
            Call::Library(read) => Ok(judge(folder, &read(folder))),
            Call::Command(arguments) => judge_command(folder, arguments),
        }
    }
}

macro_rules! reader {
    ($name:literal, $files:expr, $read:expr) => {
        Reader { name: $name, strategy: || damaged($files), call: $read }
    };
}

/// All readers.
pub const READERS: [Reader; 21] = [
    reader!("array", arrays::array_files(), Call::Library(read_array)),
    reader!("image", images::image_files(), Call::Library(read_images)),
    reader!("mesh", meshes::mesh_files(), Call::Library(read_meshes)),
    reader!("solid", solids::solid_files(), Call::Library(read_meshes)),
    reader!("model", models::model_files(), Call::Library(read_model)),
    reader!("background", runs::background_files(), Call::Library(read_background)),
    reader!("scene", scenes::scene_files(), Call::Library(read_scene)),
    reader!("nerf", datasets::nerf(), Call::Library(read_dataset)),
    reader!("neus", datasets::neus(), Call::Library(read_dataset)),
    reader!("middlebury", datasets::middlebury(), Call::Library(read_dataset)),
    reader!("colmap", datasets::colmap(), Call::Library(read_dataset)),
    reader!("llff", forms::llff(), Call::Library(read_dataset)),
    reader!("blended_mvs", forms::blended_mvs(), Call::Library(read_dataset)),
    reader!("metashape", forms::metashape(), Call::Library(read_dataset)),
    reader!("sdfstudio", forms::sdfstudio(), Call::Library(read_dataset)),
    reader!("splats", forms::splats(), Call::Library(read_dataset)),
    reader!("run", runs::run_folders(), Call::Library(read_run)),
    reader!("sweep", sweeps::sweep_files(), Call::Library(read_sweep)),
    reader!("results", sweeps::result_files(), Call::Library(read_results)),
    reader!("inspect", datasets::any_dataset(), Call::Command(&["inspect", "data"])),
    reader!("resume", runs::run_folders(), Call::Command(&RESUME)),
];

/// A resumed run of three iterations or more ends at once, whatever its budget is.
const RESUME: [&str; 6] = ["fit", "--resume", "--stop-after", "3", "-o", "run"];

/// The reader of this name; `self-test` is one with all faults, for tests.
pub fn reader(name: &str) -> Option<&'static Reader> {
    static FAULTY: Reader = Reader {
        name: "self-test",
        strategy: self_test::cases,
        call: Call::Library(self_test::read),
    };
    READERS.iter().chain([&FAULTY]).find(|reader| reader.name == name)
}

fn read_array(folder: &Path) -> anyhow::Result<()> {
    let (shape, numbers) = read_npy(&folder.join("array.npy"))?;
    anyhow::ensure!(shape.iter().product::<usize>() == numbers.len(), "{shape:?}: wrong count");
    Ok(())
}

/// The only file of the case, whatever its name is.
fn only_file(folder: &Path) -> anyhow::Result<std::path::PathBuf> {
    let mut entries = std::fs::read_dir(folder)?.flatten();
    Ok(entries.next().map_or(folder.join("missing.png"), |entry| entry.path()))
}

fn read_images(folder: &Path) -> anyhow::Result<()> {
    let path = only_file(folder)?;
    let size = image_size(&path);
    let (film, alpha) = read_image(&path)?;
    let count = film.width as usize * film.height as usize;
    anyhow::ensure!(film.pixels.len() == count, "{} pixels of {count}", film.pixels.len());
    anyhow::ensure!(alpha.is_none_or(|a| a.len() == count), "alpha of another size");
    anyhow::ensure!(size? == (film.width, film.height), "two sizes of one image");
    Ok(())
}

fn read_meshes(folder: &Path) -> anyhow::Result<()> {
    let path = only_file(folder)?;
    let points = read_points(&path);
    read_mesh(&path)?;
    // A surface is no cloud of points.
    anyhow::ensure!(points.is_err(), "points of a surface");
    Ok(())
}

fn read_model(folder: &Path) -> anyhow::Result<()> {
    Model::load(folder, &runs::run_file(1, 1, 0))?;
    Ok(())
}

fn read_background(folder: &Path) -> anyhow::Result<()> {
    Model::load(folder, &runs::room_file())?;
    Ok(())
}

fn read_scene(folder: &Path) -> anyhow::Result<()> {
    let scene = SceneFile::load(&folder.join("scene.json"))?;
    let field = scene.field::<f32>()?;
    scene.shader(&*field)?;
    Ok(())
}

fn read_dataset(folder: &Path) -> anyhow::Result<()> {
    let dataset = dataset::load(folder, &LoadOptions::default())?;
    let found = inspect::surroundings(&dataset, None, true);
    inspect::check_cameras(&dataset, &found.sphere)?;
    inspect::inspect(&dataset, &found.sphere, &found.background, "estimate");
    Ok(())
}

/// A data set of one view in memory.
fn one_view() -> Option<Dataset> {
    let (focal, principal) = (DVec2::splat(16.0), DVec2::splat(4.0));
    let (eye, up) = (DVec3::new(0.0, 0.0, 3.0), DVec3::Y);
    let camera = Camera::look_at(8, 8, focal, principal, eye, DVec3::ZERO, up)?;
    let image = Film { width: 8, height: 8, pixels: vec![[0.5; 3]; 64] };
    let view = View { name: "0".to_owned(), path: "0.png".into(), camera, image, mask: None };
    Some(Dataset {
        path: "data".into(),
        format: "memory".to_owned(),
        train: vec![view],
        test: Vec::new(),
        bounds: None,
        points: Vec::new(),
        is_sure: Vec::new(),
        notes: Vec::new(),
    })
}

fn read_run(folder: &Path) -> anyhow::Result<()> {
    let run = folder.join("run");
    let file = RunFile::load(&run)?;
    Model::load(&run, &file)?;
    let dataset = one_view().context("a camera")?;
    // The bounding sphere of a run is seen by its photographs; here, by the view in memory.
    let file = RunFile { bounds: runs::run_file(1, 1, 0).bounds, ..file };
    Session::new(&run, dataset, file, &Registry::default(), true)?;
    Ok(())
}

fn read_sweep(folder: &Path) -> anyhow::Result<()> {
    let path = folder.join("sweep.toml");
    let (sweep, _) = Sweep::load(&path.to_string_lossy())?;
    for cell in sweep.cells() {
        anyhow::ensure!(!sweep.flags(&cell).is_empty(), "a cell without options");
    }
    Ok(())
}

fn read_results(folder: &Path) -> anyhow::Result<()> {
    compare(&folder.join("a.csv"), &folder.join("b.csv"))?;
    Ok(())
}
