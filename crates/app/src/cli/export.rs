//! The colours, the size and the direction of the mesh that `dsdf mesh` writes.

use std::path::Path;

use anyhow::Context;
use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use super::common::{Global, option_error};
use super::cut::Subject;
use bake::bake;
use fit::{Model, RunCameras, RunFile, Solid};
use mesh::{Mesh, decimate, export_mesh};
use pictures::upwards;
use render::Camera;

/// An upward direction this close to an axis is taken to be the axis, in degrees: cameras that look
/// down from one side only tilt their mean.
const SNAP_DEGREES: f64 = 20.0;

/// The upward direction without cameras.
const UP_WITHOUT_CAMERAS: DVec3 = DVec3::Z;

/// Options of the file that `dsdf mesh` writes.
#[derive(Args, Debug)]
pub(super) struct Export {
    /// Vertex colours; an .stl file has none
    #[arg(long, value_enum, default_value = "auto")]
    color: Color,
    /// Axis of the data set that points up in a .glb file [default: auto]
    #[arg(long, value_enum, allow_hyphen_values = true)]
    up: Option<Up>,
    /// Factor on all lengths, for example to millimetres
    #[arg(long, default_value_t = 1.0)]
    scale: f64,
    /// Reduce the mesh to about this number of faces
    #[arg(long, value_name = "FACES", value_parser = clap::value_parser!(u32).range(4..))]
    decimate: Option<u32>,
}

/// The colours of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Color {
    /// From the cameras of the data set; none, with a warning, if they cannot be read
    Auto,
    /// None
    None,
}

/// The upward direction of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Up {
    /// The mean upward direction of the cameras, or the axis of the data set within 20° of it; z
    /// if the cameras cannot be read
    Auto,
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
}

impl Up {
    /// The direction; `None` for that of the cameras.
    fn direction(self) -> Option<DVec3> {
        match self {
            Up::Auto => None,
            Up::X => Some(DVec3::X),
            Up::Y => Some(DVec3::Y),
            Up::Z => Some(DVec3::Z),
            Up::MinusX => Some(DVec3::NEG_X),
            Up::MinusY => Some(DVec3::NEG_Y),
            Up::MinusZ => Some(DVec3::NEG_Z),
        }
    }
}

/// The colours and the direction of a file.
#[derive(Serialize)]
pub(super) struct Exported {
    /// The number of cameras that the colours come from; `None` without colours.
    color_cameras: Option<usize>,
    /// The share of the vertices that no camera sees; `None` without colours.
    unseen: Option<f64>,
    /// The direction of the data set that points up in the file; `None` where the file keeps the
    /// axes of the data set.
    up: Option<[f64; 3]>,
}

impl Exported {
    /// The end of the sentence about a mesh.
    pub(super) fn text(&self) -> String {
        let color =
            self.color_cameras.zip(self.unseen).map_or(String::new(), |(cameras, unseen)| {
                let unseen = 100.0 * unseen;
                format!(", colours of {cameras} cameras ({unseen:.1} % of the vertices unseen)")
            });
        let up = self.up.map_or(String::new(), |up| format!(", up is {}", named(up.into())));
        color + &up
    }
}

/// A direction as text: the name of an axis, or numbers.
fn named(up: DVec3) -> String {
    let axes = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)];
    for (name, axis) in axes {
        for (sign, axis) in [("", axis), ("-", -axis)] {
            if up == axis {
                return format!("{sign}{name}");
            }
        }
    }
    format!("({:.2}, {:.2}, {:.2})", up.x, up.y, up.z)
}

/// The axis within [`SNAP_DEGREES`] of a unit vector, or else the vector.
fn snapped(up: DVec3) -> DVec3 {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let cosine = SNAP_DEGREES.to_radians().cos();
    axes.into_iter().find(|axis| axis.dot(up) >= cosine).unwrap_or(up)
}

impl Export {
    /// Checks the options before the work.
    pub(super) fn check(&self, output: &Path) -> anyhow::Result<()> {
        if !(self.scale.is_finite() && self.scale > 0.0) {
            let expected = "a finite number above 0";
            return Err(option_error("scale", self.scale.to_string(), expected).into());
        }
        if self.up.is_some() && !has_extension(output, "glb") {
            let found = format!("an upward direction for {}", output.display());
            let expected = "a .glb file: files of other formats keep the axes of the data set";
            return Err(option_error("up", found, expected).into());
        }
        Ok(())
    }

    /// Writes the mesh of a run. Returns the mesh as written, in the units of the data set.
    pub(super) fn write(
        &self,
        output: &Path,
        mut mesh: Mesh,
        subject: &Subject<'_>,
        global: &Global,
    ) -> anyhow::Result<(Mesh, Exported)> {
        let Subject { model, file, run, .. } = *subject;
        if let Some(faces) = self.decimate {
            mesh = decimate(&mesh, faces as usize);
        }
        let is_colored = self.color == Color::Auto && !has_extension(output, "stl");
        let is_turned = has_extension(output, "glb");
        let up = self.up.and_then(Up::direction);
        let lack = match (is_colored, is_turned && up.is_none()) {
            (false, false) => None,
            (true, false) => Some("no colours"),
            (false, true) => Some("up is z"),
            (true, true) => Some("no colours, and up is z"),
        };
        let cameras = lack.map_or_else(Vec::new, |lack| {
            cameras_of(run, file).unwrap_or_else(|error| {
                global.say(&format!("warning: {lack}: {error:#}"));
                Vec::new()
            })
        });
        let mut exported = Exported { color_cameras: None, unseen: None, up: None };
        if is_colored && !cameras.is_empty() {
            let unseen = add_colors(&mut mesh, model, file, &cameras, global)?;
            exported.color_cameras = Some(cameras.len());
            exported.unseen = Some(unseen);
        }
        let mut export = mesh::Export { scale: self.scale, ..mesh::Export::default() };
        if is_turned {
            export.up = up.unwrap_or_else(|| up_of(&cameras, file));
            exported.up = Some(export.up.to_array());
        }
        export_mesh(output, &mesh, &export)?;
        Ok((mesh, exported))
    }
}

/// The upward direction of cameras.
fn up_of(cameras: &[Camera], file: &RunFile) -> DVec3 {
    if cameras.is_empty() {
        return UP_WITHOUT_CAMERAS;
    }
    snapped(upwards(cameras, file.sphere().center))
}

/// The training cameras of a run, relative to its origin: as the run refined them, or those of the
/// data set.
fn cameras_of(run: &Path, file: &RunFile) -> anyhow::Result<Vec<Camera>> {
    if let Some(refined) = RunCameras::load(run)? {
        return Ok(refined.cameras(file.origin(), run)?);
    }
    let cameras = dataset::open(&file.dataset).and_then(|unread| Ok(unread.cameras()?));
    let cameras = cameras.context("the data set cannot be read")?;
    Ok(cameras.iter().map(|camera| camera.about(file.origin())).collect())
}

/// Adds the colours of the vertices. Returns the share of them that no camera sees.
fn add_colors(
    mesh: &mut Mesh,
    model: &Model,
    file: &RunFile,
    cameras: &[Camera],
    global: &Global,
) -> anyhow::Result<f64> {
    let solid = Solid::new(model, file);
    let bar = global.progress("colours");
    let baked = bake(&solid.scene(cameras), &mesh.vertices, &mesh.normals, &bar.mover())?;
    bar.finish_and_clear();
    mesh.colors = baked.colors;
    Ok(baked.unseen as f64 / mesh.vertices.len().max(1) as f64)
}

/// Whether a path has an extension, in lower or upper case.
fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_near_an_axis_is_the_axis() {
        let tilted = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            DVec3::new(s, -c, 0.0)
        };
        assert_eq!(snapped(tilted(19.0)), DVec3::NEG_Y);
        assert_eq!(snapped(tilted(21.0)), tilted(21.0));
        assert_eq!(named(DVec3::NEG_Y), "-y");
        assert_eq!(named(tilted(30.0)), "(0.50, -0.87, 0.00)");
    }
}
