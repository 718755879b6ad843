//! Writing of .obj files, and of the .mtl and .png files of a textured one.

use std::io::Write;
use std::path::Path;

use glam::DVec3;
use io::{InputError, atomic_write};

use crate::write::srgb;
use crate::{Mesh, Texture};

/// The end of the name of a textured file's image.
const IMAGE: &str = "_texture.png";

/// Writes a mesh as an .obj file. The image of a texture goes to a file beside it, and its name to
/// an .mtl file; both have the name of the .obj file without its extension.
pub(crate) fn write_obj(path: &Path, mesh: &Mesh, texture: Option<&Texture>) -> anyhow::Result<()> {
    let Some(texture) = texture else {
        return atomic_write(path, |out| write(mesh, None, out));
    };
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let stem = stem.filter(|stem| !stem.contains(char::is_control)).ok_or_else(|| {
        InputError::new(path, "output", "a name that is no line of text", "letters and digits")
    })?;
    let image = format!("{stem}{IMAGE}");
    io::write_image(&path.with_file_name(&image), &texture.image)?;
    let material = format!("{stem}.mtl");
    atomic_write(&path.with_file_name(&material), |out| {
        // Without highlights: the image has the light of the photographs in it.
        let lines = "# dsdf\nnewmtl baked\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\n";
        Ok(writeln!(out, "{lines}map_Kd {image}")?)
    })?;
    atomic_write(path, |out| write(mesh, Some((texture, &material)), out))
}

/// Writes the lines of an .obj file; `texture` has the name of the material file beside it.
fn write(
    mesh: &Mesh,
    texture: Option<(&Texture, &str)>,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    writeln!(out, "# dsdf")?;
    if let Some((_, material)) = texture {
        writeln!(out, "mtllib {material}\nusemtl baked")?;
    }
    let colored = texture.is_none() && mesh.has_colors();
    for (i, v) in mesh.vertices.iter().enumerate() {
        if mesh.origin == DVec3::ZERO {
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        } else {
            let v = mesh.origin + v.as_dvec3();
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        }
        if colored {
            let [r, g, b] = srgb(mesh.colors[i]);
            write!(out, " {r:.4} {g:.4} {b:.4}")?;
        }
        writeln!(out)?;
    }
    // The second coordinate of an OBJ texture points up.
    for point in texture.iter().flat_map(|(texture, _)| &texture.points) {
        writeln!(out, "vt {} {}", point.x, 1.0 - point.y)?;
    }
    let normals = mesh.has_normals();
    for n in mesh.normals.iter().filter(|_| normals) {
        writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    for (i, face) in mesh.faces.iter().enumerate() {
        write!(out, "f")?;
        for (k, v) in face.iter().enumerate() {
            // OBJ counts from 1.
            let v = u64::from(*v) + 1;
            let point = texture.map(|(texture, _)| u64::from(texture.corners[i][k]) + 1);
            match (point, normals) {
                (None, false) => write!(out, " {v}")?,
                (None, true) => write!(out, " {v}//{v}")?,
                (Some(p), false) => write!(out, " {v}/{p}")?,
                (Some(p), true) => write!(out, " {v}/{p}/{v}")?,
            }
        }
        writeln!(out)?;
    }
    Ok(())
}
