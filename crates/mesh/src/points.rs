//! Reading of point clouds: .ply.

#![warn(clippy::cast_possible_truncation)]

use std::path::Path;

use files::{InputError, extension};
use glam::DVec3;

use crate::read::parse_ply;

/// Reads the positions of the vertices of a .ply file, ASCII or binary, in the units of the file.
///
/// Normals, colours and all other content are ignored. Positions are precise to single
/// precision, relative to the cloud's centre.
///
/// # Errors
/// If the file is missing, is damaged or too large for the memory, or if it has faces, no point, or
/// a point that is not finite: the points of a surface are not only its vertices.
pub fn read_points(path: &Path) -> Result<Vec<DVec3>, InputError> {
    let extension = extension(path);
    if extension != "ply" {
        let found = format!("extension \"{extension}\"");
        return Err(InputError::new(path, "points", found, ".ply"));
    }
    let bytes = files::read(path, "points", "a .ply file with points")?;
    let cloud = parse_ply(path, &bytes)?;
    if !cloud.faces.is_empty() {
        let found = format!("{} of them", cloud.faces.len());
        return Err(InputError::new(path, "faces", found, "points without faces (see --mesh)"));
    }
    if cloud.vertices.is_empty() {
        return Err(InputError::new(path, "vertex", "no points", "one or more"));
    }
    if let Some(i) = cloud.vertices.iter().position(|v| !v.is_finite()) {
        let (field, found) = (format!("vertex {i}"), cloud.vertices[i]);
        return Err(InputError::new(path, field, found, "finite coordinates x, y and z"));
    }
    Ok(cloud.vertices.iter().map(|v| cloud.origin + v.as_dvec3()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes a file and reads its points.
    fn read(bytes: &[u8]) -> Result<Vec<DVec3>, InputError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.PLY");
        std::fs::write(&path, bytes).unwrap();
        read_points(&path)
    }

    fn header(format: &str, count: usize, kind: &str) -> Vec<u8> {
        let lines = ["x", "y", "z"].map(|name| format!("property {kind} {name}\n")).concat();
        format!(
            "ply\nformat {format} 1.0\nelement vertex {count}\n{lines}property uchar red\n\
             end_header\n"
        )
        .into_bytes()
    }

    #[test]
    fn clouds_without_faces_are_read_in_text_and_in_both_byte_orders() {
        let points = [[1.5f64, -2.0, 0.25], [1000.5, 2000.25, -3000.0]];
        let text = b"1.5 -2 0.25 7\n1000.5 2e3 -3000 9\n".to_vec();
        let expected = vec![DVec3::from(points[0]), DVec3::new(1000.5, 2000.0, -3000.0)];
        assert_eq!(read(&[header("ascii", 2, "float"), text].concat()).unwrap(), expected);
        let expected = points.map(DVec3::from).to_vec();
        let little = |p: &[f64; 3]| [p.map(f64::to_le_bytes).concat(), vec![7]].concat();
        let body: Vec<u8> = points.iter().flat_map(little).collect();
        let file = [header("binary_little_endian", 2, "double"), body].concat();
        assert_eq!(read(&file).unwrap(), expected);
        let single = |p: &[f64; 3]| DVec3::from(*p).as_vec3().to_array();
        let big = |p: &[f64; 3]| [single(p).map(f32::to_be_bytes).concat(), vec![7]].concat();
        let body: Vec<u8> = points.iter().flat_map(big).collect();
        let file = [header("binary_big_endian", 2, "float"), body].concat();
        assert_eq!(read(&file).unwrap(), expected);
    }

    #[test]
    fn clouds_far_from_the_origin_keep_their_digits() {
        let far = [[4e6, 5e5, 100.0], [4e6 + 0.001, 5e5, 100.0], [4e6 + 1.0, 5e5, 100.0]];
        let body: Vec<u8> =
            far.iter().flat_map(|p| [p.map(f64::to_le_bytes).concat(), vec![0]].concat()).collect();
        let file = [header("binary_little_endian", 3, "double"), body].concat();
        let points = read(&file).unwrap();
        assert!((points[1].x - points[0].x - 0.001).abs() < 1e-7, "{points:?}");
    }

    #[test]
    fn empty_and_damaged_clouds_are_refused() {
        let error = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        assert!(error(&header("ascii", 0, "float")).contains("vertex: found no points"));
        let surface = String::from_utf8(header("ascii", 3, "float")).unwrap().replace(
            "end_header",
            "element face 1\nproperty list uchar int vertex_indices\nend_header",
        ) + "0 0 0 7\n1 0 0 7\n0 1 0 7\n3 0 1 2\n";
        let surface = error(surface.as_bytes());
        assert!(surface.contains("faces: found 1 of them") && surface.contains("--mesh"));
        let numbers = [1.0, f32::NAN, 2.0].map(f32::to_le_bytes).concat();
        let nan = [header("binary_little_endian", 1, "float"), numbers, vec![0]].concat();
        assert!(error(&nan).contains("vertex 0: found"), "{}", error(&nan));
        let cut = [header("binary_little_endian", 9, "float"), vec![0; 20]].concat();
        assert!(error(&cut).contains("a count of 9"), "{}", error(&cut));
        assert!(error(b"solid\n").contains("cloud.PLY"));
        let flat = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n";
        assert!(error(flat).contains("vertex 0"), "{}", error(flat));
        let obj = read_points(Path::new("cloud.obj")).unwrap_err().to_string();
        assert!(obj.contains("extension \"obj\", expected .ply"), "{obj}");
    }
}
