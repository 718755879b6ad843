//! Writing of mesh files: .ply, .obj, .glb, .usdz and .stl.

use std::path::Path;

use files::{InputError, WriteError, atomic_write, extension};
use glam::DVec3;

use crate::glb::write_glb;
use crate::obj::write_obj;
use crate::ply::write_ply;
use crate::stl::write_stl;
use crate::usdz::write_usdz;
use crate::{Export, Mesh};

/// Writes a mesh as it is: [`export_mesh`] with the default [`Export`].
///
/// # Errors
/// As of [`export_mesh`].
pub fn write_mesh(path: &Path, mesh: &Mesh) -> Result<(), WriteError> {
    export_mesh(path, mesh, &Export::default())
}

/// Writes a mesh in the format of its extension: .ply (binary, little endian), .obj, .glb (binary
/// glTF 2.0), .usdz (USD, as phones show it) or .stl (binary). A file at `path` is replaced whole.
///
/// Positions are in world units times the factor. A mesh with an origin of its own has them in
/// double precision; a .glb and a .usdz have the origin as the translation of a node. Normals and colours are
/// written if each vertex has one, but not to .stl. Colours are sRGB in .ply (bytes) and .obj (0 to
/// 1, after the position), and linear in .glb and .usdz, as other programs read them. A texture is in
/// .glb and .usdz, and beside an .obj with the name `shape` as `shape.mtl` and `shape_texture.png`.
///
/// # Errors
/// [`WriteError::Input`] if the extension is another one, the folder does not accept files, the
/// format has no textures and `export` has one, or the mesh is too far from the world's origin for
/// .stl. [`WriteError::File`] if the file cannot be written, or is a .glb or a .usdz of
/// more than 4 GiB.
pub fn export_mesh(path: &Path, mesh: &Mesh, export: &Export) -> Result<(), WriteError> {
    let extension = extension(path);
    let error = |found: &str, expected| InputError::new(path, "output", found, expected);
    if export.texture.is_some() && !["glb", "obj", "usdz"].contains(&extension.as_str()) {
        return Err(error("a mesh with a texture", ".glb, .usdz or .obj").into());
    }
    let scaled = || mesh.clone().scaled(export.scale);
    match extension.as_str() {
        "ply" => atomic_write(path, |out| write_ply(&scaled(), out)),
        "obj" => write_obj(path, &scaled(), export.texture),
        "glb" => atomic_write(path, |out| write_glb(mesh, export, out)),
        "usdz" => atomic_write(path, |out| write_usdz(mesh, export, out)),
        "stl" => {
            let reach = mesh.vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f32::max);
            check_stl(path, mesh.origin, reach.into())?;
            atomic_write(path, |out| write_stl(&scaled(), out))
        }
        other => {
            let found = format!("extension \"{other}\"");
            Err(error(&found, ".ply, .obj, .glb, .usdz or .stl").into())
        }
    }
}

/// The largest distance of neighbouring numbers in single precision, as a part of a mesh's size.
const STL_SPACING: f64 = 1e-5;

/// Checks that an .stl file at `path`, which has single precision, can hold a mesh that reaches
/// this far from `center`, both in world units.
///
/// # Errors
/// If positions would be rounded by more than 1e-5 of `reach`.
pub fn check_stl(path: &Path, center: DVec3, reach: f64) -> Result<(), InputError> {
    let spacing = f64::from(f32::EPSILON) * center.abs().max_element();
    if spacing <= STL_SPACING * reach {
        return Ok(());
    }
    let found = format!("a mesh around {center}, far from 0 for its size");
    let expected = ".ply, .obj, .glb or .usdz: .stl has single precision";
    Err(InputError::new(path, "output", found, expected))
}
