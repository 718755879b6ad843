//! Extraction of the zero level set of a field as a closed manifold mesh.

use std::collections::HashMap;

use fast_surface_nets::ndshape::ConstShape3u32;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use field::{Field, Real, Sphere};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::grid::{BLOCK, Grid, PADDED};
use crate::manifold::make_manifold;
use crate::separate::separate;
use crate::solid::Solid;
use crate::{Components, Mesh, components, project};

/// The fewest cells along the diameter; fewer give no useful surface.
const LEAST_RESOLUTION: usize = 4;

/// The fractions of progress after the grid and after the topology; projection is the rest.
const GRID_DONE: f64 = 0.8;
const TOPOLOGY_DONE: f64 = 0.9;

/// Extracts {f = 0} within the bounding sphere and drops cavities and small components: those with
/// less than 1 % of the area of the largest one.
///
/// `resolution` is the number of grid cells along the diameter, at least 4. See [`extract_with`].
pub fn extract<R: Real>(
    field: &dyn Field<R>,
    bounds: &Sphere<f64>,
    resolution: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Mesh {
    extract_with(field, bounds, resolution, Components::default(), progress)
}

/// Extracts {f = 0} within the bounding sphere and keeps the chosen components. Cavities inside the
/// solid, which no photograph can show, are kept with [`Components::All`] only.
///
/// `resolution` is the number of grid cells along the diameter, at least 4. `progress` gets the
/// fraction done, from 0 to 1, on any thread.
///
/// The mesh is closed and a manifold. Its faces point outwards, and it has unit normals along ∇f. A
/// solid that extends beyond the bounding sphere is closed by the sphere's surface; values of f
/// outside the sphere do not change the solid. The mesh is empty if there is no surface in the
/// sphere, or if the sphere has no interior or is not finite. The same input gives the same mesh on
/// any number of threads.
///
/// 1. The field is evaluated on a grid, except in blocks whose centre is far from the surface. The
///    test allows slopes of f up to twice those seen at random points ([`field::slope`]). A field
///    that is steeper elsewhere may get steps in its surface or lose parts of it, but no holes. A
///    NaN counts as outside.
/// 2. Cells are polygonised by naive surface nets (Gibson, "Constrained Elastic Surface Nets",
///    MICCAI 1998).
/// 3. Parts of the surface that touch are separated (Guéziec, Taubin, Lazarus, Horn, "Cutting and
///    Stitching", IEEE TVCG 2001).
/// 4. Vertices are moved onto the surface by Newton steps along ∇f. The mesh cuts off sharp edges
///    of the solid, by less than a cell.
/// 5. Vertices at one place are moved apart, by about 1/500 of a cell: a reader that merges equal
///    positions finds the same mesh.
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
    let grid_progress = |fraction: f64| progress(GRID_DONE * fraction);
    let grid = Grid::new(field, bounds, resolution.max(LEAST_RESOLUTION), &grid_progress);
    let mut mesh = polygonise(&grid);
    make_manifold(&mut mesh);
    if keep != Components::All {
        mesh = components::without_cavities(mesh);
    }
    mesh = components::keep_components(mesh, keep);
    progress(TOPOLOGY_DONE);
    project::onto(&Solid::new(field, bounds, grid.cell), grid.cell, &mut mesh);
    separate(&mut mesh, grid.cell);
    progress(1.0);
    mesh
}

/// The surface within one block.
#[derive(Default)]
struct BlockSurface {
    /// For every vertex a key of its cell; the same cell has the same key in every block.
    cells: Vec<u64>,
    positions: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
}

/// The surface of all blocks. Blocks overlap by the cells at their upper sides; vertices of the
/// same cell are merged.
fn polygonise(grid: &Grid) -> Mesh {
    let buffers = || (SurfaceNetsBuffer::default(), [0.0; PADDED.pow(3)]);
    let surfaces: Vec<BlockSurface> = grid
        .surface_blocks()
        .par_iter()
        .map_init(buffers, |(net, values), b| polygonise_block(grid, *b, values, net))
        .collect();
    let mut mesh = Mesh::default();
    let mut vertex_of_cell = HashMap::new();
    for surface in surfaces {
        let mut vertex = |(cell, position): (&u64, &Vec3)| {
            *vertex_of_cell.entry(*cell).or_insert_with(|| {
                mesh.vertices.push(*position);
                mesh.vertices.len() as u32 - 1
            })
        };
        let index: Vec<u32> =
            surface.cells.iter().zip(&surface.positions).map(&mut vertex).collect();
        mesh.faces.extend(surface.faces.iter().map(|f| f.map(|v| index[v as usize])));
    }
    mesh
}

/// The surface within block `b`; `values` and `net` are scratch memory.
fn polygonise_block(
    grid: &Grid,
    b: usize,
    values: &mut [f32; PADDED.pow(3)],
    net: &mut SurfaceNetsBuffer,
) -> BlockSurface {
    const SIDE: u32 = PADDED as u32;
    type Padded = ConstShape3u32<SIDE, SIDE, SIDE>;
    let block = grid.coordinates(b);
    grid.padded(block, values);
    let outside = values.iter().filter(|f| **f >= 0.0).count();
    if outside == 0 || outside == values.len() {
        return BlockSurface::default();
    }
    surface_nets(&values[..], &Padded {}, [0; 3], [SIDE - 1; 3], net);
    let corner = block.map(|c| c * BLOCK);
    let origin = DVec3::from(corner.map(|c| c as f64));
    // 21 bits for each coordinate.
    let cell_key =
        |at: &[u32; 3]| (0..3).fold(0, |key, k| key << 21 | (corner[k] as u64 + u64::from(at[k])));
    let position = |p: &[f32; 3]| grid.position(origin + Vec3::from(*p).as_dvec3()).as_vec3();
    BlockSurface {
        cells: net.surface_points.iter().map(cell_key).collect(),
        positions: net.positions.iter().map(position).collect(),
        faces: net.indices.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
    }
}
