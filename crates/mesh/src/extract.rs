//! The zero level set of a field as a closed mesh.

use std::collections::HashMap;

use fast_surface_nets::ndshape::ConstShape3u32;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use field::{Field, Real, Sphere};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::grid::{BLOCK, Grid, PADDED, Solid};
use super::manifold::make_manifold;
use super::{Components, Mesh, components, project};

/// The fewest cells along the diameter that give a surface worth the name.
const LEAST_RESOLUTION: usize = 4;

/// Extracts {f = 0} within the bounding ball, with `resolution` grid cells (at least 4) along its
/// diameter, and drops pieces of less than 1 % of the largest one's area. See [`extract_with`].
pub fn extract<R: Real>(
    field: &dyn Field<R>,
    bounds: &Sphere<f64>,
    resolution: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Mesh {
    extract_with(field, bounds, resolution, Components::default(), progress)
}

/// Extracts {f = 0} within the bounding ball, with `resolution` grid cells (at least 4) along its
/// diameter, and keeps the chosen pieces. The mesh is closed, a manifold, faces outwards and has
/// unit normals along ∇f. A solid that would leave the ball is closed by the ball's surface: what f
/// is outside does not matter. A field without a surface in the ball gives an empty mesh, and so
/// does a ball without an inside.
///
/// Blocks of the grid are skipped where f at the centre says that no surface can be near (with a
/// factor 2 for fields steeper than a distance; a steeper field gets steps, never holes). Cells are
/// polygonised by naive surface nets (Gibson 1998), parts that touch are separated, and vertices
/// are brought onto the surface by Newton steps along ∇f. Where the solid has a sharp edge the mesh
/// cuts it off, by less than a cell. A NaN counts as outside of the solid.
///
/// The same input gives the same mesh on any number of threads. `progress` is told the fraction
/// done, by any thread.
pub fn extract_with<R: Real>(
    field: &dyn Field<R>,
    bounds: &Sphere<f64>,
    resolution: usize,
    keep: Components,
    progress: &(dyn Fn(f64) + Sync),
) -> Mesh {
    if !(bounds.radius > 0.0 && bounds.radius.is_finite() && bounds.center.is_finite()) {
        return Mesh::default();
    }
    let grid = Grid::new(field, bounds, resolution.max(LEAST_RESOLUTION), &|p| progress(0.8 * p));
    let mut mesh = polygonise(&grid);
    make_manifold(&mut mesh);
    mesh = components::keep(mesh, keep);
    progress(0.9);
    project::onto(&Solid::new(field, bounds, grid.cell), grid.cell, &mut mesh);
    progress(1.0);
    mesh
}

/// A part of the surface, its vertices under the index of their cells.
#[derive(Default)]
struct Part {
    cells: Vec<u64>,
    positions: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

/// Surface nets block by block. Blocks overlap by the cells at their upper sides, whose vertices
/// are stitched.
fn polygonise(grid: &Grid) -> Mesh {
    let blocks = grid.crossed();
    let buffers = || (SurfaceNetsBuffer::default(), [0.0; PADDED.pow(3)]);
    let parts: Vec<Part> = blocks
        .par_iter()
        .map_init(buffers, |(net, values), b| polygonise_block(grid, *b, values, net))
        .collect();
    let mut mesh = Mesh::default();
    let mut vertex_of_cell = HashMap::new();
    for part in parts {
        let index: Vec<u32> = part
            .cells
            .iter()
            .zip(&part.positions)
            .map(|(cell, position)| {
                *vertex_of_cell.entry(*cell).or_insert_with(|| {
                    mesh.vertices.push(*position);
                    mesh.vertices.len() as u32 - 1
                })
            })
            .collect();
        mesh.faces.extend(part.faces.iter().map(|f| f.map(|v| index[v as usize])));
    }
    mesh
}

fn polygonise_block(
    grid: &Grid,
    b: usize,
    values: &mut [f32; PADDED.pow(3)],
    net: &mut SurfaceNetsBuffer,
) -> Part {
    const SIDE: u32 = PADDED as u32;
    type Padded = ConstShape3u32<SIDE, SIDE, SIDE>;
    let block = grid.coordinates(b);
    grid.padded(block, values);
    let outside = values.iter().filter(|f| **f >= 0.0).count();
    if outside == 0 || outside == values.len() {
        return Part::default();
    }
    surface_nets(&values[..], &Padded {}, [0; 3], [SIDE - 1; 3], net);
    let corner = block.map(|c| c * BLOCK);
    let origin = DVec3::from(corner.map(|c| c as f64));
    let cell =
        |at: &[u32; 3]| (0..3).fold(0, |key, k| key << 21 | (corner[k] as u64 + u64::from(at[k])));
    Part {
        cells: net.surface_points.iter().map(cell).collect(),
        positions: net
            .positions
            .iter()
            .map(|p| grid.position(origin + Vec3::from(*p).as_dvec3()).as_vec3())
            .collect(),
        faces: net.indices.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
    }
}
