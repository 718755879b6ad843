//! `dsdf mesh`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::{Global, check_extension, mover};
use fit::{Model, RunFile};
use io::InputError;
use mesh::{extract, write_mesh};

/// Extract a run's surface as a mesh.
#[derive(Args, Debug)]
pub(crate) struct Mesh {
    /// The run folder
    run: PathBuf,
    /// The mesh to write: .ply, .obj or .glb
    #[arg(short, long)]
    output: PathBuf,
    /// Grid cells along the bounding sphere's diameter
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=2048))]
    resolution: u32,
}

#[derive(Serialize)]
struct Report {
    vertices: usize,
    faces: usize,
    closed: bool,
    genus: Option<i64>,
    area: f64,
    volume: f64,
}

impl Mesh {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        check_extension(&self.output, &["ply", "obj", "glb"])?;
        let file = RunFile::load(&self.run)?;
        let model = Model::load(&self.run)?;
        let bar = global.progress("mesh");
        let mesh = extract(&model.field, &file.sphere(), self.resolution as usize, &mover(&bar));
        bar.finish_and_clear();
        if mesh.faces.is_empty() {
            let path = self.run.join("model.safetensors");
            return Err(InputError::new(
                path,
                "model",
                "no surface inside the bounding sphere",
                "a solid",
            )
            .into());
        }
        write_mesh(&self.output, &mesh)?;
        let report = Report {
            vertices: mesh.vertices.len(),
            faces: mesh.faces.len(),
            closed: mesh.is_closed(),
            genus: mesh.genus(),
            area: mesh.area(),
            volume: mesh.volume(),
        };
        global.report(&report, || {
            let closed = if report.closed { "closed" } else { "open" };
            format!(
                "{} vertices, {} faces, {closed}: {}",
                report.vertices,
                report.faces,
                self.output.display()
            )
        })
    }
}
