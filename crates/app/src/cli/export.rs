//! The colours, the texture, the size and the direction of the mesh that `dsdf mesh` writes.

use std::path::Path;

use anyhow::Context;
use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use super::common::{ARGUMENTS, Global, option_error};
use super::cut::Subject;
use crate::error::input_error;
use export::bake::{bake, paint, unwrap};
use files::{InputError, extension};
use fit::{RunCameras, RunFile, Solid};
use mesh::{Mesh, Texture, check_textured_obj, decimate, export_mesh};
use render::Camera;
use render::{named, snapped, upwards};

/// Bytes of memory for each texel of a texture, while it is painted.
const MEMORY_PER_TEXEL: u64 = 144;

/// The width of a texture in a .usdz file, in texels.
const USUAL_TEXTURE: u32 = 2048;

/// The upward direction without cameras.
const UP_WITHOUT_CAMERAS: DVec3 = DVec3::Z;

/// Options of the file that `dsdf mesh` writes.
#[derive(Args, Debug)]
pub(super) struct Export {
    /// Vertex colours; an .stl file has none
    #[arg(long, help_heading = "Colours, size and direction", value_enum, default_value = "auto")]
    color: Color,
    /// Width in texels of an image with the colours, in a .glb or a .usdz file or beside an .obj
    /// file, in the place of vertex colours [default for .usdz: 2048]
    #[arg(help_heading = "Colours, size and direction")]
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(64..=8192))]
    texture: Option<u32>,
    /// Axis of the data set that points up in a .glb or a .usdz file [default: auto]
    #[arg(help_heading = "Colours, size and direction")]
    #[arg(long, value_enum, allow_hyphen_values = true)]
    up: Option<Up>,
    /// Factor on all lengths, for example to millimetres
    #[arg(long, help_heading = "Colours, size and direction", default_value_t = 1.0)]
    scale: f64,
    /// Reduce the mesh to about this number of faces
    #[arg(help_heading = "Colours, size and direction")]
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

/// The share of a surface that no photograph sees, above which a sentence says how to cut it.
const MUCH_UNSEEN: f64 = 0.1;

/// The colours and the direction of a file.
#[derive(Serialize)]
pub(super) struct Exported {
    /// The number of cameras that the colours come from; `None` without colours.
    color_cameras: Option<usize>,
    /// The share of the vertices, or of a texture, that no camera sees; `None` without colours.
    unseen: Option<f64>,
    /// The image of a textured mesh.
    texture: Option<TextureReport>,
    /// The direction of the data set that points up in the file; `None` where the file keeps the
    /// axes of the data set.
    up: Option<[f64; 3]>,
}

/// The image of a textured mesh.
#[derive(Clone, Copy, Serialize)]
struct TextureReport {
    /// Width and height in texels.
    size: [u32; 2],
    /// The number of pieces of the surface that lie flat in it.
    charts: u32,
    /// The share of it that they cover.
    covered: f32,
}

impl Exported {
    /// Whether the file has vertices several times, along the seams of a texture.
    pub(super) fn has_seams(&self) -> bool {
        self.texture.is_some_and(|texture| texture.charts > 0)
    }

    /// The end of the sentence about a mesh.
    pub(super) fn text(&self) -> String {
        let of = if self.texture.is_some() { "the texture" } else { "the vertices" };
        let color =
            self.color_cameras.zip(self.unseen).map_or(String::new(), |(cameras, unseen)| {
                let cut = if unseen > MUCH_UNSEEN { "; --cull seen cuts such parts" } else { "" };
                let unseen = 100.0 * unseen;
                format!(", colours of {cameras} cameras ({unseen:.1} % of {of} unseen{cut})")
            });
        let texture =
            self.texture.map_or(String::new(), |TextureReport { size, charts, .. }| {
                format!(", {charts} charts in {} x {} texels", size[0], size[1])
            });
        let up = self.up.map_or(String::new(), |up| format!(", up is {}", named(up.into())));
        color + &texture + &up
    }
}

impl Export {
    /// Checks the options before the work.
    pub(super) fn check(&self, output: &Path) -> anyhow::Result<()> {
        if !(1e-12..=1e12).contains(&self.scale) {
            let expected = "a number from 1e-12 to 1e12";
            return Err(option_error("scale", self.scale.to_string(), expected).into());
        }
        if let Some(size) = self.texture {
            self.check_texture(size, output)?;
        }
        if self.up.and_then(Up::direction).is_some() && !is_upright(output) {
            let found = format!("an upward direction for {}", output.display());
            let expected = "a .glb or a .usdz file: others keep the axes of the data set";
            return Err(option_error("up", found, expected).into());
        }
        Ok(())
    }

    /// The texture that a file has without the option: phones show no colours of vertices.
    fn usual_texture(&self, output: &Path) -> Option<u32> {
        let fits = || check_texels(USUAL_TEXTURE).is_ok();
        (extension(output) == "usdz" && self.color == Color::Auto && fits())
            .then_some(USUAL_TEXTURE)
    }

    /// Checks that a texture of this size can be written with a mesh.
    fn check_texture(&self, size: u32, output: &Path) -> anyhow::Result<()> {
        if !["glb", "obj", "usdz"].contains(&extension(output).as_str()) {
            let found = format!("a texture for {}", output.display());
            return Err(option_error("texture", found, "a .glb, .usdz or .obj file").into());
        }
        check_texels(size)?;
        if extension(output) == "obj" {
            check_textured_obj(output)?;
        }
        if self.color == Color::None {
            return Err(option_error("texture", "--color none".to_owned(), "--color auto").into());
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
        let Subject { model, file, .. } = *subject;
        if let Some(faces) = self.decimate {
            mesh = decimate(&mesh, faces as usize);
            if mesh.faces.is_empty() {
                let found = format!("{faces}, which leaves no face of this surface");
                return Err(option_error("decimate", found, "more faces").into());
            }
        }
        let is_colored = self.color == Color::Auto && extension(output) != "stl";
        let is_turned = is_upright(output);
        let up = self.up.and_then(Up::direction);
        let lack = match (is_colored, is_turned && up.is_none()) {
            (false, false) => None,
            (true, false) => Some("no colours"),
            (false, true) => Some("up is z"),
            (true, true) => Some("no colours, and up is z"),
        };
        let must_have = self.texture.is_some() || subject.dataset.is_some();
        let cameras = match lack.map(|lack| (lack, cameras_of(subject))) {
            None => Vec::new(),
            Some((_, Ok(cameras))) => cameras,
            Some((_, Err(error))) if must_have => return Err(error),
            Some((lack, Err(error))) => {
                global.say(&format!("WARNING {lack}: {error:#}"));
                Vec::new()
            }
        };
        let mut exported = Exported { color_cameras: None, unseen: None, texture: None, up: None };
        let mut texture = None;
        if is_colored && !cameras.is_empty() {
            exported.color_cameras = Some(cameras.len());
            let colors = Colors { solid: Solid::new(model, file), cameras: &cameras, global };
            let wanted = self.texture.or_else(|| self.usual_texture(output));
            let painted = wanted.map(|size| colors.texture(&mesh, size)).transpose();
            let painted = match painted {
                // Nobody asked for the texture.
                Err(error) if self.texture.is_none() && input_error(&error).is_some() => {
                    global.say(&format!("WARNING colours of vertices, no texture: {error:#}"));
                    None
                }
                painted => painted?,
            };
            exported.unseen = Some(match painted {
                None => colors.add_to(&mut mesh)?,
                Some((image, report, unseen)) => {
                    exported.texture = Some(report);
                    texture = Some(image);
                    unseen
                }
            });
        }
        let texture = texture.as_ref();
        let mut export = mesh::Export { scale: self.scale, texture, ..mesh::Export::default() };
        if is_turned {
            export.up = up.unwrap_or_else(|| up_of(&cameras, file));
            exported.up = Some(export.up.to_array());
        }
        export_mesh(output, &mesh, &export)?;
        Ok((mesh, exported))
    }
}

/// Checks that there is memory for a texture of this size.
fn check_texels(size: u32) -> Result<(), InputError> {
    let bytes = u64::from(size) * u64::from(size) * MEMORY_PER_TEXEL;
    files::check_memory(ARGUMENTS, "--texture", format!("{size} texels"), bytes)
}

/// Whether a file has an upward direction of its own.
fn is_upright(output: &Path) -> bool {
    ["glb", "usdz"].contains(&extension(output).as_str())
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
fn cameras_of(subject: &Subject<'_>) -> anyhow::Result<Vec<Camera>> {
    let Subject { run, file, .. } = *subject;
    let of_dataset = || {
        let cameras = file.open(subject.dataset).and_then(|unread| unread.cameras());
        cameras.context("the data set cannot be read")
    };
    let other = subject.dataset.map(|_| of_dataset()).transpose()?;
    if let Some(refined) = RunCameras::load(run)? {
        return Ok(refined.cameras(file.origin(), run)?);
    }
    let cameras = other.map_or_else(of_dataset, Ok)?;
    Ok(cameras.iter().map(|camera| camera.about(file.origin())).collect())
}

/// The colours of a run, as its cameras see them.
struct Colors<'a> {
    solid: Solid<'a>,
    cameras: &'a [Camera],
    global: &'a Global,
}

impl Colors<'_> {
    /// Adds the colours of the vertices. Returns the share of them that no camera sees.
    fn add_to(&self, mesh: &mut Mesh) -> anyhow::Result<f64> {
        let bar = self.global.progress("colours");
        let scene = self.solid.scene(self.cameras);
        let baked = bake(&scene, &mesh.vertices, &mesh.normals, &bar.mover())?;
        bar.finish_and_clear();
        mesh.colors = baked.colors;
        Ok(baked.unseen as f64 / mesh.vertices.len().max(1) as f64)
    }

    /// The texture of a mesh, in an image of `size` texels, and the share of it that no camera
    /// sees.
    fn texture(&self, mesh: &Mesh, size: u32) -> anyhow::Result<(Texture, TextureReport, f64)> {
        let bar = self.global.progress("unwrap");
        let unwrapped = unwrap(mesh, size, &bar.mover()).map_err(|error| {
            let expected = "a larger image, or a mesh of fewer faces (--decimate)";
            option_error("texture", format!("{size}: {error}"), expected)
        })?;
        bar.finish_and_clear();
        let mut texture = unwrapped.texture;
        let size = [texture.image.width, texture.image.height];
        let (charts, covered) = (unwrapped.charts, unwrapped.covered);
        let bar = self.global.progress("texture");
        let unseen = paint(&self.solid.scene(self.cameras), mesh, &mut texture, &bar.mover())?;
        bar.finish_and_clear();
        Ok((texture, TextureReport { size, charts, covered }, unseen))
    }
}
