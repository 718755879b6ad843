//! Writing of .obj files, and of the .mtl and .png files of a textured one.

#![warn(clippy::cast_possible_truncation)]

use std::io::{self, Write};
use std::path::Path;

use files::{InputError, WriteError, atomic_write};

use crate::{Mesh, Texture};

/// The end of the name of a textured file's image.
const IMAGE: &str = "_texture.png";

/// The start of the material files of dsdf.
const MATERIAL: &str = "# dsdf\nnewmtl baked\n";

/// The names of the material file and of the image of a textured .obj file.
fn names_beside(path: &Path) -> Result<[String; 2], InputError> {
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    // Readers of .mtl files trim blanks, and take a leading dash as an option.
    let is_plain = |stem: &&str| {
        stem.trim() == *stem
            && !stem.starts_with('-')
            && !stem.contains(|c: char| c.is_control() || c == '\\')
    };
    let stem = stem.filter(is_plain).ok_or_else(|| {
        let found = "a name that an .mtl file cannot hold";
        InputError::new(path, "output", found, "letters, digits and underscores")
    })?;
    // Many readers end a name at a blank.
    let stem = stem.replace(char::is_whitespace, "_");
    Ok([format!("{stem}.mtl"), format!("{stem}{IMAGE}")])
}

/// Checks that the files beside a textured .obj file can be written, before the work for them, and
/// that they replace none of another program.
///
/// # Errors
/// [`WriteError::Input`] if the name is not one that readers of .mtl files understand, one of the
/// files cannot be written, or one is there and the material file is not dsdf's.
/// [`WriteError::Folder`] if the disk is full.
pub fn check_textured_obj(path: &Path) -> Result<(), WriteError> {
    let beside = names_beside(path)?.map(|name| path.with_file_name(name));
    for file in &beside {
        files::check_output(file)?;
    }
    let is_own = std::fs::read(&beside[0]).is_ok_and(|b| b.starts_with(MATERIAL.as_bytes()));
    match beside.iter().find(|file| file.symlink_metadata().is_ok()) {
        Some(file) if !is_own => {
            let expected = "no file, or one that dsdf wrote: choose another name for the mesh";
            Err(InputError::new(file, "output", "a file of another program", expected).into())
        }
        _ => Ok(()),
    }
}

/// Writes a mesh as an .obj file. The image of a texture goes to a file beside it, and its name to
/// an .mtl file; both have the name of the .obj file without its extension, with underscores for
/// blanks.
pub(crate) fn write_obj(
    path: &Path,
    mesh: &Mesh,
    texture: Option<&Texture>,
) -> Result<(), WriteError> {
    let Some(texture) = texture else {
        return atomic_write(path, |out| write(mesh, None, out));
    };
    check_textured_obj(path)?;
    let [material, image] = names_beside(path)?;
    film::write_image(&path.with_file_name(&image), &texture.image)?;
    atomic_write(&path.with_file_name(&material), |out| {
        // Without highlights: the image has the light of the photographs in it.
        writeln!(out, "{MATERIAL}Ka 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {image}")
    })?;
    atomic_write(path, |out| write(mesh, Some((texture, &material)), out))
}

/// Writes the lines of an .obj file; `texture` has the name of the material file beside it.
fn write(mesh: &Mesh, texture: Option<(&Texture, &str)>, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "# dsdf")?;
    if let Some((_, material)) = texture {
        writeln!(out, "mtllib {material}\nusemtl baked")?;
    }
    let colored = texture.is_none() && mesh.has_colors();
    for (i, v) in mesh.vertices.iter().enumerate() {
        if mesh.is_far() {
            let v = mesh.origin + v.as_dvec3();
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        } else {
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        }
        if colored {
            let [r, g, b] = mesh.srgb(i);
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
