//! The reference `contour`: silhouettes and creases traced on a fine grid of the film.

mod cell;
mod crease;
mod edge;

use field::Real;
use glam::DVec2;
use render::{InvalidField, Pixel, Scene};

use crate::crossing::{has_visible_creases, with_steps_for_wedges};
use crate::discontinuity::Discontinuity;
use crate::estimator::{Batch, Estimator, SilhouetteMask};
use crate::record::{FilmLine, Record, SegmentEnd, Stratification, add_smooth_part};
use cell::{Piece, pieces};
use edge::{Event, EventKind, GridEdge};

/// A reference: silhouettes as polygons on a grid of cells, and the smooth part along the lines of
/// the grid.
///
/// If the rays at the two ends of an edge of a cell hit different surfaces, the edge is halved
/// until it is 1e-9 pixels long. The rays at its ends then give the contrast and the silhouette
/// point. These points are the corners of the polygons. The error of their length is of second
/// order in the size of a cell. The grid has √spp cells along the side of a pixel, at least 4 and
/// at most 256.
///
/// This estimator shares no search and no random number with the others. It is slow, and it misses
/// parts thinner than a cell.
#[derive(Clone, Copy, Debug)]
pub struct Contour;

/// The grid of every pixel.
#[derive(Clone, Copy, Debug)]
struct Grid {
    /// Cells along a side of a pixel.
    cells: u32,
}

/// The least and the largest number of cells along a side of a pixel.
const CELLS: [u32; 2] = [4, 256];

impl Grid {
    /// A grid with as many cells as samples.
    fn of(spp: u32) -> Self {
        Grid { cells: (f64::from(spp).sqrt().ceil() as u32).clamp(CELLS[0], CELLS[1]) }
    }

    /// The edges of one pixel's grid: along x row by row, then along y column by column.
    fn edges<R: Real>(self, pixel: &Pixel) -> Vec<GridEdge<R>> {
        let (n, corner) = (self.cells, pixel.corner());
        let at = |axis: usize, line: u32, along: u32| {
            let (a, b) = (f64::from(along) / f64::from(n), f64::from(line) / f64::from(n));
            corner + if axis == 0 { DVec2::new(a, b) } else { DVec2::new(b, a) }
        };
        let ends = move |axis, line, along| [at(axis, line, along), at(axis, line, along + 1)];
        (0..2)
            .flat_map(|axis| {
                (0..=n).flat_map(move |line| (0..n).map(move |along| (axis, line, along)))
            })
            .map(|(axis, line, along)| GridEdge::new(pixel.camera, ends(axis, line, along)))
            .collect()
    }

    /// The index of an edge among its pixel's.
    fn index(self, axis: u32, line: u32, along: u32) -> usize {
        let n = self.cells;
        ((axis * (n + 1) + line) * n + along) as usize
    }

    /// Adds the pieces of silhouettes and creases in every cell of one pixel.
    fn add_cells<R: Real>(self, pixel: u32, edges: &[GridEdge<R>], record: &mut Record<R>) {
        for y in 0..self.cells {
            for x in 0..self.cells {
                let four = [
                    self.index(0, y, x),
                    self.index(1, x + 1, y),
                    self.index(0, y + 1, x),
                    self.index(1, x, y),
                ];
                let (creases, silhouettes): (Vec<Event<R>>, Vec<Event<R>>) = four
                    .iter()
                    .flat_map(|&e| edges[e].events.iter().copied())
                    .partition(|event| event.kind == EventKind::Crease);
                for events in [silhouettes, creases] {
                    let side = 1.0 / f64::from(self.cells);
                    pieces(&events, side).iter().for_each(|piece| add_piece(pixel, piece, record));
                }
            }
        }
    }

    /// Adds the smooth part along the lines of the grid, by the trapezoid rule across them.
    fn add_smooth<R: Real>(
        self,
        scene: &Scene<'_, R>,
        pixels: &[Pixel],
        edges: &[Vec<GridEdge<R>>],
        record: &mut Record<R>,
    ) -> Result<(), InvalidField> {
        let (mut lines, mut ends) = (Vec::new(), Vec::new());
        for (index, (pixel, edges)) in pixels.iter().zip(edges).enumerate() {
            for (axis, line) in
                (0..2).flat_map(|axis| (0..=self.cells).map(move |line| (axis, line)))
            {
                let of_line = (0..self.cells).map(|along| self.index(axis, line, along));
                let events = of_line.flat_map(|index| &edges[index].events);
                let number = lines.len();
                ends.extend(events.map(|event| {
                    let s = (event.u - pixel.corner())[axis as usize];
                    SegmentEnd { line: number, s, steep: event.grazing }
                }));
                let end = line == 0 || line == self.cells;
                lines.push(FilmLine {
                    pixel: index as u32,
                    camera: pixel.camera,
                    axis: axis as usize,
                    start: edges[self.index(axis, line, 0)].ends[0],
                    weight: if end { 0.5 } else { 1.0 } / f64::from(self.cells),
                });
            }
        }
        ends.sort_by(|a, b| a.line.cmp(&b.line).then(a.s.total_cmp(&b.s)));
        let stratification =
            Stratification { offset: &vec![0.5; lines.len()], per_pixel: self.cells };
        add_smooth_part(scene, &lines, stratification, &ends, record)
    }
}

/// Adds a piece, with half of its length at each of its ends.
fn add_piece<R: Real>(pixel: u32, piece: &Piece<R>, record: &mut Record<R>) {
    for event in &piece.ends {
        for (x, rgb) in event.points.into_iter().zip(event.rgb) {
            record.silhouettes.push(pixel, x, rgb * R::of(0.5 * piece.length));
        }
    }
}

// Generic implementations would be compiled again in each crate that names the estimator.

impl Estimator<f32> for Contour {
    fn record(
        &self,
        scene: &Scene<'_, f32>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<f32>, InvalidField> {
        record(scene, batch)
    }

    fn differentiates_cameras(&self) -> bool {
        true
    }

    fn unmodelled(&self, scene: &Scene<'_, f32>) -> Vec<Discontinuity> {
        unmodelled(scene)
    }

    fn depends_on_seed(&self) -> bool {
        false
    }
}

impl Estimator<f64> for Contour {
    fn record(
        &self,
        scene: &Scene<'_, f64>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<f64>, InvalidField> {
        record(scene, batch)
    }

    fn differentiates_cameras(&self) -> bool {
        true
    }

    fn unmodelled(&self, scene: &Scene<'_, f64>) -> Vec<Discontinuity> {
        unmodelled(scene)
    }

    fn depends_on_seed(&self) -> bool {
        false
    }
}

/// [`Estimator::record`].
fn record<R: Real>(scene: &Scene<'_, R>, batch: &Batch<'_>) -> Result<Record<R>, InvalidField> {
    let scene = &with_steps_for_wedges(*scene);
    let grid = Grid::of(batch.counts.spp);
    let mut record = Record::black(batch.pixels.len());
    let mut all = Vec::with_capacity(batch.pixels.len());
    for (index, pixel) in batch.pixels.iter().enumerate() {
        let mut edges = grid.edges::<R>(pixel);
        edge::locate(scene, &mut edges)?;
        if has_visible_creases(scene) {
            crease::locate(scene, &mut edges)?;
        }
        grid.add_cells(index as u32, &edges, &mut record);
        all.push(edges);
    }
    grid.add_smooth(scene, batch.pixels, &all, &mut record)?;
    Ok(record)
}

/// [`Estimator::unmodelled`].
fn unmodelled<R: Real>(scene: &Scene<'_, R>) -> Vec<Discontinuity> {
    let modelled = [Discontinuity::Silhouettes, Discontinuity::Creases];
    Discontinuity::of_scene_except(scene, &modelled)
}
