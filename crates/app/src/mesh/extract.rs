//! The zero level set of a field as a closed mesh.

use std::sync::atomic::{AtomicUsize, Ordering};

use fast_surface_nets::ndshape::RuntimeShape;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use field::{Field, Sphere};
use glam::Vec3;
use rayon::prelude::*;

use super::{Mesh, components};
use crate::fit::single;

/// Grid points along a side of a block that is evaluated, or not, as a whole.
const BLOCK: usize = 8;

/// How much steeper than a distance the field may be between a block's centre and its corners, for its sign to hold.
const STEEPNESS: f32 = 2.0;

/// Pieces below this share of the largest one's faces are dust.
const DUST: f64 = 0.01;

/// Newton steps that bring vertices from the grid's interpolation onto the surface.
const NEWTON: usize = 3;

/// The grid: points around the bounding ball with one cell to spare on every side.
struct Grid {
    low: Vec3,
    cell: f32,
    side: usize,
    bounds: Sphere<f32>,
}

impl Grid {
    fn at(&self, [x, y, z]: [usize; 3]) -> Vec3 {
        self.low + self.cell * Vec3::new(x as f32, y as f32, z as f32)
    }

    /// What the solid is cut to: a network exists in its ball only.
    fn ball(&self, x: Vec3) -> f32 {
        (x - self.bounds.center).length() - self.bounds.radius
    }
}

/// Extracts {f = 0} within the bounding ball, with `resolution` grid cells along its diameter. A solid that would leave
/// the ball is closed by the ball's surface.
///
/// Blocks of the grid are skipped where f at the centre says that no surface can be near (with a factor 2 for fields
/// steeper than a distance). Cells are polygonised by naive surface nets (one vertex a cell, quadrilaterals between: closed
/// by construction), and vertices brought onto the surface by Newton steps along ∇f, at most half a cell. `progress` is
/// told the fraction done.
pub fn extract(
    field: &dyn Field<f32>,
    bounds: &Sphere<f64>,
    resolution: usize,
    progress: &(dyn Fn(f64) + Sync),
) -> Mesh {
    let bounds = single(bounds);
    let cell = 2.0 * bounds.radius / resolution as f32;
    let side = (resolution + 3).div_ceil(BLOCK) * BLOCK;
    let low = bounds.center - Vec3::splat(0.5 * cell * (side - 1) as f32);
    let grid = Grid { low, cell, side, bounds };
    let values = evaluate(field, &grid, progress);
    let (n, mut net) = (side as u32, SurfaceNetsBuffer::default());
    surface_nets(&values, &RuntimeShape::<u32, 3>::new([n; 3]), [0; 3], [n - 1; 3], &mut net);
    let vertices = net.positions.iter().map(|p| grid.low + grid.cell * Vec3::from(*p)).collect();
    let faces = net.indices.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect();
    let mut mesh = components::without_small(Mesh { vertices, normals: Vec::new(), faces }, DUST);
    if mesh.volume() < 0.0 {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    project(field, &grid, &mut mesh);
    mesh
}

/// f at all grid points, or something of the same sign where no surface is near; outside the ball, positive.
fn evaluate(field: &dyn Field<f32>, grid: &Grid, progress: &(dyn Fn(f64) + Sync)) -> Vec<f32> {
    let (side, blocks, done) = (grid.side, grid.side / BLOCK, AtomicUsize::new(0));
    let reach = STEEPNESS * 0.5 * BLOCK as f32 * grid.cell * 3f32.sqrt();
    let mut values = vec![0.0; side * side * side];
    // A slab of blocks is contiguous: z is the slowest coordinate.
    values.par_chunks_mut(BLOCK * side * side).enumerate().for_each(|(bz, slab)| {
        let corner = |b: usize| [b % blocks * BLOCK, b / blocks * BLOCK, bz * BLOCK];
        let half = 0.5 * (BLOCK - 1) as f32 * grid.cell;
        let centers: Vec<Vec3> = (0..blocks * blocks).map(|b| grid.at(corner(b)) + half).collect();
        let mut f = vec![0.0; centers.len()];
        field.value(&centers, &mut f);
        let (mut x, mut g) = (Vec::new(), Vec::new());
        for (b, center) in centers.iter().enumerate() {
            let (f, ball) = (f[b], grid.ball(*center));
            let far = f.max(ball).abs() > reach || ball > reach;
            let points = block_points(corner(b));
            if far {
                points.for_each(|p| slab[index(p, bz, side)] = f.max(ball));
                continue;
            }
            x.clear();
            x.extend(points.map(|p| grid.at(p)));
            g.resize(x.len(), 0.0);
            field.value(&x, &mut g);
            for (p, (x, g)) in block_points(corner(b)).zip(x.iter().zip(&g)) {
                slab[index(p, bz, side)] = g.max(grid.ball(*x));
            }
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(done as f64 / blocks as f64);
    });
    values
}

fn block_points([x, y, z]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..BLOCK.pow(3)).map(move |i| [x + i % BLOCK, y + i / BLOCK % BLOCK, z + i / BLOCK / BLOCK])
}

/// The place of a grid point in the slab of blocks `bz`.
fn index([x, y, z]: [usize; 3], bz: usize, side: usize) -> usize {
    ((z - bz * BLOCK) * side + y) * side + x
}

/// Moves vertices onto {max(f, ball) = 0} and gives them its normals.
fn project(field: &dyn Field<f32>, grid: &Grid, mesh: &mut Mesh) {
    const CHUNK: usize = 1024;
    mesh.normals = vec![Vec3::ZERO; mesh.vertices.len()];
    let chunks = mesh.vertices.par_chunks_mut(CHUNK).zip(mesh.normals.par_chunks_mut(CHUNK));
    chunks.for_each(|(vertices, normals)| {
        let (mut f, start) = (vec![0.0; vertices.len()], vertices.to_vec());
        for step in 0..=NEWTON {
            field.value_gradient(vertices, &mut f, normals);
            for (i, x) in vertices.iter_mut().enumerate() {
                let ball = grid.ball(*x);
                if ball > f[i] {
                    (f[i], normals[i]) = (ball, (*x - grid.bounds.center).normalize_or_zero());
                }
                if step < NEWTON {
                    let moved = *x - normals[i] * (f[i] / normals[i].length_squared().max(1e-12));
                    let away = (moved - start[i]).clamp_length_max(0.5 * grid.cell);
                    *x = if away.is_finite() { start[i] + away } else { start[i] };
                }
            }
        }
        normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    });
}
