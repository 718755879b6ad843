//! The unwrapping of a mesh into an image.

use film::Film;
use glam::Vec2;
use mesh::{Mesh, Texture};
use uvunwrap::{Density, MeshInput, Options, Packing, Stage};

use crate::bake::GREY;
use crate::bake::texels::GUTTER;

/// A mesh cut into charts that lie flat in an image.
#[derive(Clone, Debug)]
pub struct Unwrapped {
    /// The places of the faces in an image that is grey as yet.
    pub texture: Texture,
    /// The number of charts.
    pub charts: u32,
    /// The share of the image that the charts cover.
    pub covered: f32,
}

/// A mesh that has no unwrapping.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnwrapError {
    /// The mesh is not one that can be unwrapped.
    #[error("the mesh cannot be unwrapped: {0}")]
    Mesh(#[from] uvunwrap::Error),
    /// The charts do not fit into the image.
    #[error("an image of {size} x {size} texels is too small for the {charts} charts of the mesh")]
    TooManyCharts {
        /// The width of the image in texels.
        size: u32,
        /// The number of charts.
        charts: u32,
    },
}

/// Cuts a mesh into charts that lie flat, without overlap, in an image of `size` × `size` texels.
///
/// The image ends at the last row that a chart covers. The crate `uvunwrap` does the work: charts
/// grow from faces with alike normals, are flattened with little change of angles and areas, and
/// are placed at one scale. A chart is turned at most, never mirrored, in the image. `progress`
/// gets the fraction done, on any thread. The result has the same bits on any number of threads.
///
/// # Errors
/// If a vertex is not finite, a face has an index beyond the vertices, `size` is below 5, or the
/// charts do not fit.
pub fn unwrap(
    mesh: &Mesh,
    size: u32,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Unwrapped, UnwrapError> {
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.to_array()).collect();
    let options = Options {
        density: Density::Auto { page_size: size },
        padding: GUTTER,
        packing: Packing::Fast,
        ..Options::default()
    };
    let input = MeshInput::new(&positions, mesh.faces.as_flattened());
    let atlas = uvunwrap::generate_with_progress(&[input], &options, |at| {
        if let (Stage::Parameterizing, Some(total)) = (at.stage, at.total) {
            progress(at.done as f64 / total as f64);
        }
        true
    })?;
    if atlas.page_count > 1 {
        return Err(UnwrapError::TooManyCharts { size, charts: atlas.chart_count });
    }
    let unwrapped = &atlas.meshes[0];
    // The crate's points turn counter-clockwise with the second coordinate upwards.
    let points = unwrapped.vertices.iter().map(|v| Vec2::new(v.uv[0], 1.0 - v.uv[1])).collect();
    let texels = atlas.width as usize * atlas.height as usize;
    let texture = Texture {
        image: Film::grey(atlas.width, atlas.height, std::iter::repeat_n(GREY.x, texels)),
        points,
        vertices: unwrapped.vertices.iter().map(|v| v.xref).collect(),
        corners: unwrapped.indices.as_chunks().0.to_vec(),
    };
    Ok(Unwrapped { texture, charts: atlas.chart_count, covered: atlas.utilization })
}

#[cfg(test)]
mod tests {
    use field::{Kind, Shape, Sphere};
    use glam::DVec3;

    use super::*;

    fn torus() -> Mesh {
        let torus = Shape::<f64>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.7, 0.25]);
        let bounds = Sphere { center: DVec3::ZERO, radius: 1.2 };
        mesh::extract(&torus, &bounds, 48, &|_| {})
    }

    #[test]
    fn a_torus_lies_flat_with_little_distortion_and_is_not_mirrored() {
        let mesh = torus();
        let Unwrapped { texture, charts, covered } = unwrap(&mesh, 512, &|_| {}).unwrap();
        assert!((2..100).contains(&charts) && covered > 0.4, "{charts} charts cover {covered}");
        assert_eq!(texture.corners.len(), mesh.faces.len());
        let (width, height) = (texture.image.width as f32, texture.image.height as f32);
        assert!(width == 512.0 && height <= 512.0);
        let mut ratios = Vec::new();
        for (i, corners) in texture.corners.iter().enumerate() {
            assert_eq!(corners.map(|c| texture.vertices[c as usize]), mesh.faces[i]);
            let [a, b, c] = corners.map(|c| texture.points[c as usize]);
            for p in [a, b, c] {
                assert!(p.cmpge(Vec2::ZERO).all() && p.cmple(Vec2::ONE).all());
            }
            // The second coordinate points down: counter-clockwise triangles are negative.
            let flat = -(b - a).perp_dot(c - a) * width * height;
            assert!(flat > 0.0, "face {i} is mirrored");
            ratios.push(f64::from(flat) / mesh.face_cross(i).length());
        }
        ratios.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
        assert!(at(0.95) / at(0.05) < 2.0, "areas from {} to {}", at(0.05), at(0.95));
    }

    #[test]
    fn a_mesh_without_an_unwrapping_is_refused() {
        let error = unwrap(&torus(), 8, &|_| {}).unwrap_err();
        assert!(matches!(error, UnwrapError::TooManyCharts { size: 8, .. }), "{error}");
        let broken = Mesh { vertices: vec![glam::Vec3::NAN; 3], ..Mesh::default() };
        let broken = Mesh { faces: vec![[0, 1, 2]], ..broken };
        assert!(matches!(unwrap(&broken, 64, &|_| {}), Err(UnwrapError::Mesh(_))));
    }
}
