//! Writing of .usdz files: a scene description as text (USD's own format `usda`) and the texture, in
//! a ZIP archive as Pixar's "Usdz File Format Specification" (version 1.3) asks for: files are not
//! compressed, and begin at multiples of 64 bytes.

use std::fmt::Write as _;
use std::io::{self, Write};

use glam::{DQuat, DVec3, Vec3};

use crate::{Export, Mesh};

/// The names of the files in the archive. The scene is the first.
const SCENE: &str = "object.usda";
const TEXTURE: &str = "texture.png";

/// Writes the mesh as a .usdz file.
pub(crate) fn write_usdz(mesh: &Mesh, export: &Export, out: &mut dyn Write) -> io::Result<()> {
    let mut archive = Archive::default();
    archive.add(SCENE, scene(mesh, export).as_bytes(), out)?;
    if let Some(texture) = export.texture {
        archive.add(TEXTURE, &film::png(&texture.image).map_err(io::Error::other)?, out)?;
    }
    archive.finish(out)
}

/// The scene: an upright object with one mesh and, if the mesh has colours, one matt material.
fn scene(whole: &Mesh, export: &Export) -> String {
    let split = export.texture.map(|texture| texture.split(whole));
    let mesh = split.as_ref().unwrap_or(whole);
    let material = match (export.texture, mesh.has_colors()) {
        (Some(_), _) => Some(OF_TEXTURE),
        (None, true) => Some(OF_COLORS),
        (None, false) => None,
    };
    let rotation = DQuat::from_rotation_arc(export.up, DVec3::Y).normalize();
    let (x, y, z) = (rotation.x, rotation.y, rotation.z);
    let [schemas, binding] = match material {
        None => ["", ""],
        Some(_) => [
            "\n        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    ",
            "        rel material:binding = </object/material>\n",
        ],
    };
    let low = mesh.vertices.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = mesh.vertices.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let mut text = format!(
        "#usda 1.0
(
    defaultPrim = \"object\"
    doc = \"dsdf\"
    metersPerUnit = 1
    upAxis = \"Y\"
)

def Xform \"object\" (
    kind = \"component\"
)
{{
    quatd xformOp:orient = ({w}, {x}, {y}, {z})
    double3 xformOp:scale = {scale}
    uniform token[] xformOpOrder = [\"xformOp:orient\", \"xformOp:scale\"]

    def Mesh \"surface\" ({schemas})
    {{
        uniform bool doubleSided = {sides}
        float3[] extent = [{low}, {high}]
        uniform token subdivisionScheme = \"none\"
        double3 xformOp:translate = {origin}
        uniform token[] xformOpOrder = [\"xformOp:translate\"]
{binding}",
        w = rotation.w,
        scale = triple(DVec3::splat(export.scale).to_array()),
        sides = u8::from(!whole.is_closed()),
        low = triple(low.to_array()),
        high = triple(high.to_array()),
        origin = triple(mesh.origin.to_array()),
    );
    add_lists(&mut text, mesh, export);
    text + "    }\n" + material.unwrap_or_default() + "}\n"
}

/// Adds the lists of the mesh.
fn add_lists(text: &mut String, mesh: &Mesh, export: &Export) {
    list(text, "int[] faceVertexCounts", mesh.faces.iter().map(|_| 3), "");
    list(text, "int[] faceVertexIndices", mesh.faces.as_flattened().iter(), "");
    let vectors = |all: &[Vec3]| all.iter().map(|v| triple(v.to_array())).collect::<Vec<_>>();
    list(text, "point3f[] points", vectors(&mesh.vertices).iter(), "");
    if mesh.has_normals() {
        list(text, "normal3f[] normals", vectors(&mesh.normals).iter(), PER_VERTEX);
    }
    if mesh.has_colors() {
        let colors = vectors(&mesh.colors);
        list(text, "color3f[] primvars:displayColor", colors.iter(), PER_VERTEX);
    }
    if let Some(texture) = export.texture {
        // Rows of an image go upwards in USD.
        let points = texture.points.iter().map(|p| format!("({}, {})", p.x, 1.0 - p.y));
        list(text, "texCoord2f[] primvars:st", points, PER_VERTEX);
    }
}

/// The metadata of a list with one element for each vertex.
const PER_VERTEX: &str = " (\n            interpolation = \"vertex\"\n        )";

/// Adds an attribute that is a list.
fn list<T: std::fmt::Display>(
    text: &mut String,
    name: &str,
    values: impl Iterator<Item = T>,
    metadata: &str,
) {
    let _ = write!(text, "        {name} = [");
    for (i, value) in values.enumerate() {
        let comma = if i == 0 { "" } else { ", " };
        let _ = write!(text, "{comma}{value}");
    }
    let _ = writeln!(text, "]{metadata}");
}

fn triple<T: std::fmt::Display>([x, y, z]: [T; 3]) -> String {
    format!("({x}, {y}, {z})")
}

/// A material that is as rough as can be: the colours are those that cameras saw.
macro_rules! material {
    ($color:literal, $shaders:literal) => {
        concat!(
            "
    def Material \"material\"
    {
        token outputs:surface.connect = </object/material/shader.outputs:surface>

        def Shader \"shader\"
        {
            uniform token info:id = \"UsdPreviewSurface\"
            color3f inputs:diffuseColor.connect = </object/material/",
            $color,
            ">
            float inputs:metallic = 0
            float inputs:roughness = 1
            token outputs:surface
        }
",
            $shaders,
            "    }\n"
        )
    };
}

/// The colours are those of the image.
const OF_TEXTURE: &str = material!(
    "image.outputs:rgb",
    "
        def Shader \"points\"
        {
            uniform token info:id = \"UsdPrimvarReader_float2\"
            string inputs:varname = \"st\"
            float2 outputs:result
        }

        def Shader \"image\"
        {
            uniform token info:id = \"UsdUVTexture\"
            asset inputs:file = @texture.png@
            token inputs:sourceColorSpace = \"sRGB\"
            float2 inputs:st.connect = </object/material/points.outputs:result>
            token inputs:wrapS = \"clamp\"
            token inputs:wrapT = \"clamp\"
            float3 outputs:rgb
        }
"
);

/// The colours are those of the vertices.
const OF_COLORS: &str = material!(
    "colors.outputs:result",
    "
        def Shader \"colors\"
        {
            uniform token info:id = \"UsdPrimvarReader_float3\"
            string inputs:varname = \"displayColor\"
            float3 outputs:result
        }
"
);

/// The bytes at whose multiples a file begins.
const ALIGNMENT: usize = 64;

/// The header of a file of padding in the extra field of an entry: a number of no meaning, and its
/// length.
const PADDING: u16 = 0x1986;

/// The version of ZIP that a reader needs: 1.0.
const NEEDED: u16 = 10;

/// The date 1 January 1980: the first there is. The same mesh has the same bytes on any day.
const DATE: u16 = 0x21;

/// A ZIP archive of files without compression (PKWARE, "APPNOTE.TXT", sections 4.3.7, 4.3.12 and
/// 4.3.16).
#[derive(Default)]
struct Archive {
    /// Bytes written.
    length: usize,
    entries: u16,
    /// The directory at the end.
    directory: Vec<u8>,
}

impl Archive {
    fn add(&mut self, name: &str, content: &[u8], out: &mut dyn Write) -> io::Result<()> {
        let size = size_of(content.len())?;
        let place = size_of(self.length)?;
        let start = self.length + LOCAL_BYTES + name.len() + PADDING_BYTES;
        let padding = start.next_multiple_of(ALIGNMENT) - start;
        // What the local header and the directory have in common.
        let mut common = Vec::new();
        for word in [NEEDED, 0, 0, 0, DATE] {
            common.extend_from_slice(&word.to_le_bytes());
        }
        for word in [crc32fast::hash(content), size, size] {
            common.extend_from_slice(&word.to_le_bytes());
        }
        common.extend_from_slice(&(name.len() as u16).to_le_bytes());
        let mut head = b"PK\x03\x04".to_vec();
        head.extend_from_slice(&common);
        head.extend_from_slice(&((PADDING_BYTES + padding) as u16).to_le_bytes());
        head.extend_from_slice(name.as_bytes());
        head.extend_from_slice(&PADDING.to_le_bytes());
        head.extend_from_slice(&(padding as u16).to_le_bytes());
        head.resize(head.len() + padding, 0);
        out.write_all(&head)?;
        out.write_all(content)?;
        self.length += head.len() + content.len();
        self.entries += 1;

        self.directory.extend_from_slice(b"PK\x01\x02");
        self.directory.extend_from_slice(&NEEDED.to_le_bytes());
        self.directory.extend_from_slice(&common);
        // No extra field, comment or attributes; the first disk.
        self.directory.extend_from_slice(&[0; 12]);
        self.directory.extend_from_slice(&place.to_le_bytes());
        self.directory.extend_from_slice(name.as_bytes());
        Ok(())
    }

    fn finish(self, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&self.directory)?;
        out.write_all(b"PK\x05\x06\0\0\0\0")?;
        for count in [self.entries, self.entries] {
            out.write_all(&count.to_le_bytes())?;
        }
        for number in [size_of(self.directory.len())?, size_of(self.length)?] {
            out.write_all(&number.to_le_bytes())?;
        }
        out.write_all(&[0, 0])
    }
}

/// The bytes of a local header without its name and its extra field.
const LOCAL_BYTES: usize = 30;

/// The bytes of the header of the padding.
const PADDING_BYTES: usize = 4;

fn size_of(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        io::Error::other("a .usdz file holds at most 4 GiB; a .ply file has no such limit")
    })
}
