//! The values of the solid's F on a cubic grid, evaluated only where the surface may be.
//!
//! The grid is divided into blocks of 8³ points, and a block into sub-blocks of 4³ points. If F at
//! the centre of a block is far enough from 0, the whole block is inside or outside, and only that
//! is stored. The same test is applied to the sub-blocks of the other blocks.

use std::sync::atomic::{AtomicUsize, Ordering};

use field::{Field, Real, SLOPE_POINTS, Sphere, Vector3, slope};
use glam::DVec3;
use rayon::prelude::*;

use crate::solid::Solid;

/// Grid points along a side of a block.
pub(crate) const BLOCK: usize = 8;

/// Grid points along a side of a sub-block.
const SUBBLOCK: usize = 4;

/// Sub-blocks of a block.
const SUBBLOCKS: usize = (BLOCK / SUBBLOCK).pow(3);

/// The slope of the field between the centre of a block and its corners, up to which the test above
/// is right, in slopes that the field is seen to have ([`field::slope`]).
const LARGEST_SLOPE: f64 = 2.0;

/// Grid points along a side of a block with its padding.
pub(crate) const PADDED: usize = BLOCK + 2;

/// Blocks that a thread evaluates at once: the field gets batches of 16 · 8³ = 8192 points at most.
const BATCH: usize = 16;

/// F at the points of a cubic grid.
pub(crate) struct Grid {
    /// The position of grid point (0, 0, 0), world units.
    low: DVec3,
    /// The distance between neighbouring points, world units.
    pub(crate) cell: f64,
    /// The slope that the field is seen to have.
    slope: f64,
    /// The number of blocks along a side.
    blocks: usize,
    /// For every block `OUTSIDE`, `INSIDE`, or the index of its values.
    state: Vec<u32>,
    /// F at the points of the evaluated blocks, x fastest.
    values: Vec<[f32; BLOCK.pow(3)]>,
}

/// The state of a block without a surface, outside the solid.
const OUTSIDE: u32 = u32::MAX;
/// The state of a block without a surface, inside the solid.
const INSIDE: u32 = u32::MAX - 1;
/// The state of a block that the surface may cross, before it gets an index.
const MIXED: u32 = u32::MAX - 2;

impl Grid {
    /// Evaluates the field with `resolution` cells along the diameter of the bounding sphere.
    ///
    /// Points at the border of the grid are outside the sphere. `progress` gets the fraction done.
    pub(crate) fn new<R: Real>(
        field: &dyn Field<R>,
        bounds: &Sphere<f64>,
        resolution: usize,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Self {
        let cell = 2.0 * bounds.radius / resolution as f64;
        let blocks = (resolution + 3).div_ceil(BLOCK);
        // The number of points along a side is even. So the planes through the centre, where
        // symmetric solids often have faces, are between points.
        let low = bounds.center - DVec3::splat(0.5 * cell * (blocks * BLOCK - 1) as f64);
        let ball = Sphere { center: R::Vec3::of(bounds.center), radius: R::of(bounds.radius) };
        let slope = slope(field, &ball, SLOPE_POINTS).to_double();
        let mut grid = Grid { low, cell, slope, blocks, state: Vec::new(), values: Vec::new() };
        let solid = Solid::new(field, bounds, cell);
        grid.state = grid.classify_blocks(&solid);
        grid.evaluate(&solid, progress);
        grid
    }

    /// The world position of a point in grid coordinates.
    pub(crate) fn position(&self, grid: DVec3) -> DVec3 {
        self.low + self.cell * grid
    }

    /// The world position of the centre of a cube of `size`³ points with the lowest point `corner`.
    fn center(&self, corner: [usize; 3], size: usize) -> DVec3 {
        self.position(DVec3::from(corner.map(|c| c as f64)) + 0.5 * (size - 1) as f64)
    }

    /// The block coordinates of block `b`.
    pub(crate) fn coordinates(&self, b: usize) -> [usize; 3] {
        [b % self.blocks, b / self.blocks % self.blocks, b / self.blocks.pow(2)]
    }

    /// The state of a cube of `size`³ points by F at its centre; `MIXED` if F may vanish in it.
    fn classify(&self, center_value: f64, size: usize) -> u32 {
        let reach = LARGEST_SLOPE * self.slope * 0.5 * (size - 1) as f64 * self.cell * 3f64.sqrt();
        match center_value {
            f if f > reach => OUTSIDE,
            f if f < -reach => INSIDE,
            _ => MIXED,
        }
    }

    /// The state of every block.
    fn classify_blocks<R: Real>(&self, solid: &Solid<R>) -> Vec<u32> {
        /// Blocks that a thread classifies at once.
        const CHUNK: usize = 4096;
        let count = self.blocks.pow(3);
        let chunk = |c: usize| {
            let blocks = c * CHUNK..((c + 1) * CHUNK).min(count);
            let centers: Vec<DVec3> = blocks
                .map(|b| self.center(self.coordinates(b).map(|c| c * BLOCK), BLOCK))
                .collect();
            solid.value(&centers).into_iter().map(|f| self.classify(f, BLOCK)).collect::<Vec<u32>>()
        };
        (0..count.div_ceil(CHUNK)).into_par_iter().flat_map_iter(chunk).collect()
    }

    /// Evaluates the mixed blocks and gives them the indices of their values.
    fn evaluate<R: Real>(&mut self, solid: &Solid<R>, progress: &(dyn Fn(f64) + Sync)) {
        let mixed: Vec<usize> = (0..self.state.len()).filter(|b| self.state[*b] == MIXED).collect();
        mixed.iter().enumerate().for_each(|(i, b)| self.state[*b] = i as u32);
        let mut values = vec![[0.0; BLOCK.pow(3)]; mixed.len()];
        let done = AtomicUsize::new(0);
        let batches = values.par_chunks_mut(BATCH).zip(mixed.par_chunks(BATCH));
        // A program that stops a command unwinds from `progress`.
        batches.panic_fuse().for_each(|(values, blocks)| {
            self.evaluate_blocks(solid, blocks, values);
            let done = done.fetch_add(blocks.len(), Ordering::Relaxed) + blocks.len();
            progress(done as f64 / mixed.len() as f64);
        });
        self.values = values;
    }

    /// Evaluates a batch of blocks; `values` has one array for each. All points of a sub-block
    /// without a surface get the value at its centre.
    fn evaluate_blocks<R: Real>(
        &self,
        solid: &Solid<R>,
        blocks: &[usize],
        values: &mut [[f32; BLOCK.pow(3)]],
    ) {
        let corners = self.subblock_corners(blocks);
        let centers: Vec<DVec3> = corners.iter().map(|c| self.center(*c, SUBBLOCK)).collect();
        let (mut mixed, mut x) = (Vec::new(), Vec::new());
        for (s, f) in solid.value(&centers).into_iter().enumerate() {
            if self.classify(f, SUBBLOCK) == MIXED {
                mixed.push(s);
                x.extend(cube_points(corners[s], SUBBLOCK).map(|p| self.center(p, 1)));
            } else {
                let block = &mut values[s / SUBBLOCKS];
                cube_points(corners[s], SUBBLOCK).for_each(|p| block[value_index(p)] = f as f32);
            }
        }
        let values_at_x = solid.value(&x);
        for (s, subblock_values) in mixed.iter().zip(values_at_x.chunks_exact(SUBBLOCK.pow(3))) {
            for (p, f) in cube_points(corners[*s], SUBBLOCK).zip(subblock_values) {
                values[s / SUBBLOCKS][value_index(p)] = *f as f32;
            }
        }
    }

    /// The lowest grid point of every sub-block of `blocks`, block by block.
    fn subblock_corners(&self, blocks: &[usize]) -> Vec<[usize; 3]> {
        let corners = |b: &usize| {
            let block = self.coordinates(*b);
            (0..SUBBLOCKS).map(move |s| {
                let subblock = unravel(s, BLOCK / SUBBLOCK);
                [0, 1, 2].map(|k| block[k] * BLOCK + subblock[k] * SUBBLOCK)
            })
        };
        blocks.iter().flat_map(corners).collect()
    }

    /// The blocks that can have a cell in which F changes sign, in ascending order.
    ///
    /// A cell of a block reaches one point into the next blocks, and the cells of the array that
    /// [`Grid::padded`] fills reach two. So a block counts if it or one of its upper neighbours is
    /// mixed, or if two of them differ in sign.
    pub(crate) fn surface_blocks(&self) -> Vec<usize> {
        let mixed_or_two_signs = |b: &usize| {
            let block = self.coordinates(*b);
            let state = |i: usize| {
                let offset = unravel(i, 2);
                self.state([0, 1, 2].map(|k| block[k] + offset[k]))
            };
            (0..8).any(|i| state(i) < MIXED || state(i) != state(0))
        };
        (0..self.state.len()).into_par_iter().filter(mixed_or_two_signs).collect()
    }

    /// The state of a block in block coordinates; blocks beyond the grid are outside the solid.
    fn state(&self, block: [usize; 3]) -> u32 {
        let in_grid = block.iter().all(|c| *c < self.blocks);
        if in_grid {
            self.state[(block[2] * self.blocks + block[1]) * self.blocks + block[0]]
        } else {
            OUTSIDE
        }
    }

    /// Fills `values` with F at the points of a block and of two layers of the next blocks on each
    /// upper side, x fastest.
    pub(crate) fn padded(&self, block: [usize; 3], values: &mut [f32; PADDED.pow(3)]) {
        for (i, value) in values.iter_mut().enumerate() {
            let offset = unravel(i, PADDED);
            let point = [0, 1, 2].map(|k| block[k] * BLOCK + offset[k]);
            *value = match self.state(point.map(|c| c / BLOCK)) {
                OUTSIDE => self.cell as f32,
                INSIDE => -self.cell as f32,
                index => self.values[index as usize][value_index(point)],
            };
        }
    }
}

/// The coordinates of element `i` of a cube of `side`³ elements, x fastest.
fn unravel(i: usize, side: usize) -> [usize; 3] {
    [i % side, i / side % side, i / side / side]
}

/// The grid points of a cube of `side`³ points with the lowest point `corner`, x fastest.
fn cube_points(corner: [usize; 3], side: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..side.pow(3)).map(move |i| {
        let offset = unravel(i, side);
        [0, 1, 2].map(|k| corner[k] + offset[k])
    })
}

/// The index of a grid point in the array of its block.
fn value_index([x, y, z]: [usize; 3]) -> usize {
    (z % BLOCK * BLOCK + y % BLOCK) * BLOCK + x % BLOCK
}
