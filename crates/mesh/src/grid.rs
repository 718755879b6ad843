//! The field on a grid around the bounding ball, evaluated only where its surface can be.

use std::sync::atomic::{AtomicUsize, Ordering};

use field::{Field, Real, Sphere, Vector3};
use glam::DVec3;
use rayon::prelude::*;

/// Grid points along a side of a block, and of the parts of a block, that are evaluated, or not, as
/// a whole.
pub(super) const BLOCK: usize = 8;
const PART: usize = 4;

/// How much steeper than a distance the field may be between a block's centre and its corners, for
/// its sign to hold.
const STEEPNESS: f64 = 2.0;

/// Points along a side of a block with its padding.
pub(super) const PADDED: usize = BLOCK + 2;

/// Blocks that a thread takes at once: the field sees batches of at most 32³ / 4 points.
const BATCH: usize = 16;

/// Stands for an infinity: far beyond any scene, and safe to interpolate with.
const FAR: f64 = 1e30;

/// A solid {F ≤ 0}, F = max(f, distance to the bounding ball): a field cut to the ball it exists
/// in.
pub(super) struct Solid<'a, R: Real> {
    field: &'a dyn Field<R>,
    bounds: Sphere<f64>,
    /// What a NaN inside the ball stands for: this far outside of the solid.
    outside: f64,
}

impl<'a, R: Real> Solid<'a, R> {
    pub(super) fn new(field: &'a dyn Field<R>, bounds: &Sphere<f64>, outside: f64) -> Self {
        Solid { field, bounds: *bounds, outside }
    }

    /// The signed distance to the bounding ball.
    fn ball(&self, x: DVec3) -> f64 {
        (x - self.bounds.center).length() - self.bounds.radius
    }

    /// F(x), finite.
    fn value(&self, x: &[DVec3]) -> Vec<f64> {
        let points: Vec<R::Vec3> = x.iter().map(|x| Vector3::of(*x)).collect();
        let mut f = vec![R::zero(); x.len()];
        self.field.value(&points, &mut f);
        x.iter().zip(&f).map(|(x, f)| self.cut(f.to_double(), self.ball(*x))).collect()
    }

    /// F(x), finite, and ∇F(x).
    pub(super) fn value_gradient(&self, x: &[DVec3]) -> Vec<(f64, DVec3)> {
        let points: Vec<R::Vec3> = x.iter().map(|x| Vector3::of(*x)).collect();
        let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
        self.field.value_gradient(&points, &mut f, &mut gradient);
        let cut = |((x, f), gradient): ((&DVec3, &R), &R::Vec3)| {
            let ball = self.ball(*x);
            let value = self.cut(f.to_double(), ball);
            let on_ball = ball >= value;
            (
                value,
                if on_ball {
                    (x - self.bounds.center).normalize_or_zero()
                } else {
                    gradient.to_double()
                },
            )
        };
        x.iter().zip(&f).zip(&gradient).map(cut).collect()
    }

    fn cut(&self, f: f64, ball: f64) -> f64 {
        let f = if f.is_nan() { self.outside } else { f };
        f.max(ball).clamp(-FAR, FAR)
    }
}

/// F at the points of a cubic grid; blocks without a surface are kept as a sign.
pub(super) struct Grid {
    /// The place of grid point (0, 0, 0), world units.
    low: DVec3,
    /// The distance of neighbouring points, world units.
    pub(super) cell: f64,
    /// Blocks along a side.
    blocks: usize,
    /// A sign, or where in `values` the block's values are.
    state: Vec<u32>,
    /// Values of the evaluated blocks, x fastest.
    values: Vec<[f32; BLOCK.pow(3)]>,
}

const OUTSIDE: u32 = u32::MAX;
const INSIDE: u32 = u32::MAX - 1;
const MIXED: u32 = u32::MAX - 2;

impl Grid {
    /// Evaluates the field with `resolution` cells along the ball's diameter. Points on the grid's
    /// border lie outside of the ball. `progress` is told the fraction done.
    pub(super) fn new<R: Real>(
        field: &dyn Field<R>,
        bounds: &Sphere<f64>,
        resolution: usize,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Self {
        let cell = 2.0 * bounds.radius / resolution as f64;
        let blocks = (resolution + 3).div_ceil(BLOCK);
        // The number of points is even, so the planes through the centre, where symmetric solids
        // like to have faces, lie between points.
        let low = bounds.center - DVec3::splat(0.5 * cell * (blocks * BLOCK - 1) as f64);
        let mut grid = Grid { low, cell, blocks, state: Vec::new(), values: Vec::new() };
        let solid = Solid::new(field, bounds, cell);
        grid.state = grid.signs(&solid);
        grid.evaluate(&solid, progress);
        grid
    }

    /// The world position of a point in grid coordinates.
    pub(super) fn position(&self, grid: DVec3) -> DVec3 {
        self.low + self.cell * grid
    }

    fn center(&self, corner: [usize; 3], size: usize) -> DVec3 {
        self.position(DVec3::from(corner.map(|c| c as f64)) + 0.5 * (size - 1) as f64)
    }

    /// Block coordinates of block `b`.
    pub(super) fn coordinates(&self, b: usize) -> [usize; 3] {
        [b % self.blocks, b / self.blocks % self.blocks, b / self.blocks.pow(2)]
    }

    /// The sign that a cube of `size`³ points has throughout, from F at its centre; `MIXED` if F
    /// may vanish in it.
    fn sign(&self, center: f64, size: usize) -> u32 {
        let reach = STEEPNESS * 0.5 * (size - 1) as f64 * self.cell * 3f64.sqrt();
        match center {
            f if f > reach => OUTSIDE,
            f if f < -reach => INSIDE,
            _ => MIXED,
        }
    }

    /// The state of every block, from its centre.
    fn signs<R: Real>(&self, solid: &Solid<R>) -> Vec<u32> {
        const CHUNK: usize = 4096;
        let count = self.blocks.pow(3);
        let chunk = |c: usize| {
            let blocks = c * CHUNK..((c + 1) * CHUNK).min(count);
            let centers: Vec<DVec3> = blocks
                .map(|b| self.center(self.coordinates(b).map(|c| c * BLOCK), BLOCK))
                .collect();
            solid.value(&centers).into_iter().map(|f| self.sign(f, BLOCK)).collect::<Vec<u32>>()
        };
        (0..count.div_ceil(CHUNK)).into_par_iter().flat_map_iter(chunk).collect()
    }

    /// Fills in the mixed blocks.
    fn evaluate<R: Real>(&mut self, solid: &Solid<R>, progress: &(dyn Fn(f64) + Sync)) {
        let mixed: Vec<usize> = (0..self.state.len()).filter(|b| self.state[*b] == MIXED).collect();
        mixed.iter().enumerate().for_each(|(i, b)| self.state[*b] = i as u32);
        let mut values = vec![[0.0; BLOCK.pow(3)]; mixed.len()];
        let done = AtomicUsize::new(0);
        values.par_chunks_mut(BATCH).zip(mixed.par_chunks(BATCH)).for_each(|(values, blocks)| {
            self.evaluate_blocks(solid, blocks, values);
            let done = done.fetch_add(blocks.len(), Ordering::Relaxed) + blocks.len();
            progress(done as f64 / mixed.len() as f64);
        });
        self.values = values;
    }

    /// The same once more with the parts of a batch of blocks, then point by point.
    fn evaluate_blocks<R: Real>(
        &self,
        solid: &Solid<R>,
        blocks: &[usize],
        values: &mut [[f32; BLOCK.pow(3)]],
    ) {
        const PARTS: usize = (BLOCK / PART).pow(3);
        const POINTS: usize = PART.pow(3);
        let corners: Vec<[usize; 3]> = (0..blocks.len() * PARTS)
            .map(|p| {
                let (block, part) =
                    (self.coordinates(blocks[p / PARTS]), unravel(p % PARTS, BLOCK / PART));
                [0, 1, 2].map(|k| block[k] * BLOCK + part[k] * PART)
            })
            .collect();
        let point = |p: usize, i: usize| {
            let offset = unravel(i, PART);
            [0, 1, 2].map(|k| corners[p][k] + offset[k])
        };
        let centers: Vec<DVec3> = corners.iter().map(|c| self.center(*c, PART)).collect();
        let coarse = solid.value(&centers);
        let (mut mixed, mut x) = (Vec::new(), Vec::new());
        for (p, f) in coarse.iter().enumerate() {
            if self.sign(*f, PART) == MIXED {
                mixed.push(p);
                x.extend((0..POINTS).map(|i| self.center(point(p, i), 1)));
            } else {
                (0..POINTS).for_each(|i| values[p / PARTS][place(point(p, i))] = *f as f32);
            }
        }
        for (i, f) in solid.value(&x).into_iter().enumerate() {
            let p = mixed[i / POINTS];
            values[p / PARTS][place(point(p, i % POINTS))] = f as f32;
        }
    }

    /// Blocks with a cell in which F changes sign, where a cell reaches up to one point into the
    /// next blocks (and the cells that [`Grid::padded`] holds, two). In ascending order.
    pub(super) fn crossed(&self) -> Vec<usize> {
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

    fn state(&self, block: [usize; 3]) -> u32 {
        let inside = block.iter().all(|c| *c < self.blocks);
        if inside {
            self.state[(block[2] * self.blocks + block[1]) * self.blocks + block[0]]
        } else {
            OUTSIDE
        }
    }

    /// F at the points of a block and two layers of the next blocks on each upper side, x fastest.
    pub(super) fn padded(&self, block: [usize; 3], values: &mut [f32; PADDED.pow(3)]) {
        for (i, value) in values.iter_mut().enumerate() {
            let offset = unravel(i, PADDED);
            let point = [0, 1, 2].map(|k| block[k] * BLOCK + offset[k]);
            *value = match self.state(point.map(|c| c / BLOCK)) {
                OUTSIDE => self.cell as f32,
                INSIDE => -self.cell as f32,
                mixed => self.values[mixed as usize][place(point)],
            };
        }
    }
}

/// The coordinates of element `i` of a cube of `side`³ elements, x fastest.
fn unravel(i: usize, side: usize) -> [usize; 3] {
    [i % side, i / side % side, i / side / side]
}

/// Where a block keeps the value of a grid point.
fn place([x, y, z]: [usize; 3]) -> usize {
    (z % BLOCK * BLOCK + y % BLOCK) * BLOCK + x % BLOCK
}
