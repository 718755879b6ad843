//! `dsdf mesh`.

use std::path::{Path, PathBuf};

use clap::Args;
use export::cut::CutReport;
use serde::Serialize;

use super::common::Global;
use super::cut::{CutOptions, Subject};
use super::export::{Export, Exported};
use files::{InputError, extension};
use fit::{Model, RunFile, RunFolder};
use mesh::{check_stl, extract};

/// Arguments of `dsdf mesh`.
#[derive(Args, Debug)]
pub(crate) struct Mesh {
    /// Run folder
    run: PathBuf,
    /// Mesh to write: .ply, .obj, .glb, .usdz or .stl
    #[arg(short, long)]
    output: PathBuf,
    /// Grid cells along the diameter of the bounding sphere
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=2048))]
    resolution: u32,
    #[command(flatten)]
    pub(super) cut: CutOptions,
    #[command(flatten)]
    export: Export,
}

/// The size and the topology of an extracted mesh.
#[derive(Serialize)]
pub(super) struct MeshReport {
    /// Number of vertices.
    vertices: usize,
    /// Number of triangles.
    faces: usize,
    /// Whether the mesh has no border. Programs that do not merge the vertices of equal positions
    /// see borders along the seams of a texture.
    closed: bool,
    /// Number of handles; `None` unless the mesh is closed and of one piece.
    genus: Option<i64>,
    /// Surface area, in squared data set units.
    area: f64,
    /// Enclosed volume, in cubed data set units; without meaning if the mesh is open.
    volume: f64,
    /// The parts that were cut off.
    cut: Vec<CutReport>,
    /// The colours and the direction of the file.
    #[serde(flatten)]
    exported: Exported,
}

/// The mesh of a run, with `cells` grid cells along the diameter of its bounding sphere.
pub(super) fn mesh_of_run(
    model: &Model,
    file: &RunFile,
    cells: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> mesh::Mesh {
    let mesh = extract(&model.field, &file.sphere(), cells, progress);
    mesh::Mesh { origin: file.origin(), ..mesh }
}

impl Mesh {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let report = self.write(global)?;
        global.report(&report, || report.text(&self.output))
    }

    /// Extracts the surface and writes the file.
    pub(super) fn write(&self, global: &Global) -> anyhow::Result<MeshReport> {
        global.will_write(&self.output, &["ply", "obj", "glb", "usdz", "stl"])?;
        self.export.check(&self.output)?;
        let file = RunFile::load(&self.run)?;
        if extension(&self.output) == "stl" {
            let sphere = file.world_sphere();
            check_stl(&self.output, sphere.center, sphere.radius)?;
        }
        let model = Model::load(&self.run, &file)?;
        let bar = global.progress("mesh");
        let cells = self.resolution as usize;
        let mesh = mesh_of_run(&model, &file, cells, &bar.mover());
        bar.finish_and_clear();
        if mesh.faces.is_empty() {
            let path = RunFolder::new(&self.run).model();
            let found = "no surface inside the bounding sphere";
            return Err(InputError::new(path, "model", found, "a solid").into());
        }
        let dataset = self.cut.dataset.as_deref();
        let subject = Subject { model: &model, run: &self.run, file: &file, dataset, cells };
        let (mesh, cut) = self.cut.apply(mesh, &subject, global)?;
        let (mesh, exported) = self.export.write(&self.output, mesh, &subject, global)?;
        Ok(MeshReport { cut, ..MeshReport::new(&mesh, exported) })
    }
}

impl MeshReport {
    fn new(mesh: &mesh::Mesh, exported: Exported) -> Self {
        MeshReport {
            vertices: mesh.vertices.len(),
            faces: mesh.faces.len(),
            closed: mesh.is_closed(),
            genus: mesh.genus(),
            area: mesh.area(),
            volume: mesh.volume(),
            cut: Vec::new(),
            exported,
        }
    }

    /// The mesh of this file, in words.
    pub(super) fn text(&self, path: &Path) -> String {
        let closed = match (self.closed, self.exported.has_seams()) {
            (true, false) => "closed",
            (true, true) => "closed (merge vertices of equal positions: the texture has seams)",
            (false, _) => "open",
        };
        let exported = self.exported.text();
        let cut = self.cut.iter().map(|cut| format!("\n{}", cut.text())).collect::<String>();
        let (vertices, faces, path) = (self.vertices, self.faces, path.display());
        format!("{vertices} vertices, {faces} faces, {closed}{exported}: {path}{cut}")
    }
}
