//! Values of f on a lattice: rays skip the places that these show to be empty.

use field::{Field, Real, Sphere, Vector3};

use crate::point::Point;
use crate::ray::Ray;

/// Cells of a lattice along a side of its cube.
const CELLS: usize = 32;

/// Nodes along a side.
const NODES: usize = CELLS + 1;

/// The error of an interpolated value, in second differences of the nodes around it. Between two
/// nodes, the error is an eighth of the second difference if f is a parabola there, and half of it
/// at most if f has a kink.
const ERROR_OF_DIFFERENCE: f64 = 0.5;

/// The distance between the numbers of neighbouring nodes, by axis.
const BESIDE: [usize; 3] = [NODES * NODES, NODES, 1];

/// The numbers of the nodes of a cell, without that of its first node.
const CORNERS: [usize; 8] = {
    let [x, y, z] = BESIDE;
    [0, z, y, y + z, x, x + z, x + y, x + y + z]
};

/// A skipped part ends where the empty ball has a smaller radius than this, in cells: the next steps
/// would gain less than an evaluation of f there.
const SHORTEST_STEP: f64 = 1.0 / 16.0;

/// A ray falls to the surface, rather than graze it, if ∂f/∂t is below this, in units of −L.
const FALLING: f64 = 0.25;

/// The most steps through the lattice.
const MOST_STEPS: usize = 128;

/// Values of f on a cubic lattice around a ball.
///
/// [`intersect_rows`](crate::intersect_rows) starts rays near the surface with it. Between the
/// nodes, f is interpolated, and the second differences of the values bound the error: also at the
/// tip of the distance to a small solid. In a field that is no distance, a part of the solid that no
/// node shows, thinner than a cell, can be missed. Rays do not trust a lattice
/// whose bound an evaluation violates: they are traced again without it.
#[derive(Clone, Debug)]
pub struct Lattice<R: Real> {
    /// The corner of the cube with the smallest coordinates, in world units.
    corner: R::Vec3,
    /// The length of a side of a cell, in world units.
    cell: R,
    /// f at the nodes, x slowest. NaN at nodes that no cell of the ball has.
    f: Vec<R>,
    /// The largest error of the interpolated value in a cell, x slowest; NaN if a node of it has no
    /// value.
    error: Vec<R>,
    /// The largest change of f since then, in world units.
    drift: R,
    /// The steepest slope between neighbouring nodes.
    slope: R,
}

/// A part of a ray without an evaluation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skip<R> {
    /// The end of the part: the place of the next evaluation.
    pub(crate) t: R,
    /// A lower bound of f there: a smaller value shows that the lattice is wrong.
    pub(crate) bound: R,
    /// ∂f/∂t there.
    pub(crate) slope: R,
    /// The place with the smallest clearance on the way, with the lower bound of f there.
    pub(crate) closest: Point<R>,
}

impl<R: Real> Lattice<R> {
    /// The lattice of a field around a ball.
    pub fn new(field: &(impl Field<R> + ?Sized), ball: &Sphere<R>) -> Self {
        let places = Self::places(ball);
        let mut f = vec![R::zero(); places.len()];
        field.value(&places, &mut f);
        Self::of_values(ball, &f)
    }

    /// The length of a side of a cell around a ball, in world units.
    ///
    /// The ball touches the outer cells from inside at half of their width, so that rounding does
    /// not bring the ends of rays outside.
    pub fn cell(ball: &Sphere<R>) -> R {
        ball.radius * R::of(2.0 / (CELLS as f64 - 1.0))
    }

    /// The nodes around a ball at which a lattice needs values of f, in world units.
    pub fn places(ball: &Sphere<R>) -> Vec<R::Vec3> {
        nodes_of(ball).map(|node| place(ball, node)).collect()
    }

    /// The lattice of these values at [`places`](Self::places).
    ///
    /// # Panics
    /// If the number of values is wrong.
    pub fn of_values(ball: &Sphere<R>, values: &[R]) -> Self {
        let mut f = vec![R::nan(); NODES.pow(3)];
        assert_eq!(values.len(), nodes_of(ball).count(), "values of a lattice");
        nodes_of(ball).zip(values).for_each(|(node, value)| f[number(node)] = *value);
        let differences = second_differences(&f);
        let mut error = Vec::with_capacity(CELLS.pow(3));
        for first in all_cells() {
            let (mut largest, mut sum) = (R::zero(), R::zero());
            for corner in CORNERS {
                largest = largest.max(differences[first + corner]);
                sum += f[first + corner];
            }
            let error_of_cell = largest * R::of(ERROR_OF_DIFFERENCE);
            error.push(if sum.is_nan() { R::nan() } else { error_of_cell });
        }
        let cell = Self::cell(ball);
        let slope = steepest(&f) / cell;
        Lattice { corner: place(ball, [0; 3]), cell, f, error, drift: R::zero(), slope }
    }

    /// The lattice for a field that has changed by at most `drift` since, in world units.
    #[must_use]
    pub fn with_drift(self, drift: R) -> Self {
        Lattice { drift, ..self }
    }

    /// The part of a ray from the distance `from` on that is empty by this lattice. Slopes of f are
    /// at most `steepest`.
    ///
    /// It ends where a falling ray meets the surface, or else where the ray comes so close to the
    /// surface that its approach matters: with a clearance below `reach`. `None` if no part is empty.
    pub(crate) fn skip(&self, ray: &Ray<R>, from: R, reach: R, steepest: R) -> Option<Skip<R>> {
        let steepest = steepest.max(self.slope);
        let shortest = self.cell * R::of(SHORTEST_STEP);
        let (mut t, mut clear, mut is_near) = (from, None, false);
        let (mut closest, mut clearance) = (Point { t: from, f: R::infinity() }, R::infinity());
        for _ in 0..MOST_STEPS {
            let (f, slope, error) = self.at(ray.at(t), ray.direction)?;
            let bound = f - error;
            let radius = bound / steepest;
            let was_near = is_near;
            is_near = radius <= reach * t;
            if is_near && slope > steepest * R::of(-FALLING) || was_near && !is_near {
                return clear;
            }
            if !is_near && radius < clearance * t {
                (clearance, closest) = (radius / t, Point { t, f: bound });
            }
            let here = Some(Skip { t, bound, slope, closest });
            if !is_near {
                clear = here;
            }
            if radius < shortest {
                return here.filter(|_| t > from);
            }
            if t >= ray.far {
                return clear;
            }
            t = (t + radius).min(ray.far);
        }
        clear
    }

    /// The interpolated value of f at a point, its slope along a direction, and the largest error of
    /// the value. `None` outside the lattice.
    fn at(&self, x: R::Vec3, direction: R::Vec3) -> Option<(R, R, R)> {
        let inverse = R::one() / self.cell;
        let y = ((x - self.corner) * inverse).to_array();
        let mut cell = [0; 3];
        for a in 0..3 {
            // A NaN and numbers outside fail one of both.
            cell[a] = y[a].to_usize().filter(|i| *i < CELLS)?;
        }
        let error = self.error[(cell[0] * CELLS + cell[1]) * CELLS + cell[2]];
        let [u, v, w] = [0, 1, 2].map(|a| y[a] - R::of(cell[a] as f64));
        let first = number(cell);
        // Along z, then along y, then along x: value and slope.
        let along_z = |node: usize| {
            let (a, b) = (self.f[node], self.f[node + 1]);
            [a + (b - a) * w, b - a]
        };
        let along_y = |node: usize| {
            let ([a, za], [b, zb]) = (along_z(node), along_z(node + NODES));
            [a + (b - a) * v, b - a, za + (zb - za) * v]
        };
        let ([a, ya, za], [b, yb, zb]) = (along_y(first), along_y(first + NODES * NODES));
        let f = a + (b - a) * u;
        let slopes = R::Vec3::new(b - a, ya + (yb - ya) * u, za + (zb - za) * u);
        let slope = slopes.dot(direction) * inverse;
        error.is_finite().then_some((f, slope, error + self.drift))
    }
}

/// A node in world space.
fn place<R: Real>(ball: &Sphere<R>, node: [usize; 3]) -> R::Vec3 {
    let cell = Lattice::cell(ball);
    let offset = node.map(|i| R::of(i as f64 - 0.5 * CELLS as f64) * cell);
    ball.center + R::Vec3::from_array(offset)
}

/// The nodes of all cells that meet the ball, and some more.
fn nodes_of<R: Real>(ball: &Sphere<R>) -> impl Iterator<Item = [usize; 3]> {
    let most = (ball.radius + Lattice::cell(ball) * R::of(2.0)).to_double();
    let cell = Lattice::cell(ball).to_double();
    let away = move |node: &[usize; 3]| {
        let square = |i: usize| ((i as f64 - 0.5 * CELLS as f64) * cell).powi(2);
        node.map(square).iter().sum::<f64>().sqrt()
    };
    all_nodes().filter(move |node| away(node) <= most)
}

fn all_nodes() -> impl Iterator<Item = [usize; 3]> {
    (0..NODES.pow(3)).map(|node| of_number(node, NODES))
}

/// The index along each axis of a number, x slowest.
fn of_number(number: usize, side: usize) -> [usize; 3] {
    [number / side / side, number / side % side, number % side]
}

/// The number of a node, x slowest.
fn number([x, y, z]: [usize; 3]) -> usize {
    (x * NODES + y) * NODES + z
}

/// The first node of each cell, x slowest.
fn all_cells() -> impl Iterator<Item = usize> {
    let rows = (0..CELLS).flat_map(|x| (0..CELLS).map(move |y| number([x, y, 0])));
    rows.flat_map(|row| row..row + CELLS)
}

/// For each node, the sum over axes of the sizes of the second differences of f around it: the
/// errors along the axes add up at the tip of a small solid. At the ends of an axis, the difference
/// of the node beside counts; without a value, none.
fn second_differences<R: Real>(f: &[R]) -> Vec<R> {
    let mut sums = vec![R::zero(); f.len()];
    for beside in BESIDE {
        for (number, sum) in sums.iter_mut().enumerate() {
            let place = number / beside % NODES;
            let middle = match place {
                0 => number + beside,
                CELLS => number - beside,
                _ => number,
            };
            let difference = f[middle - beside] + f[middle + beside] - (f[middle] + f[middle]);
            if !difference.is_nan() {
                *sum += difference.abs();
            }
        }
    }
    sums
}

/// The largest difference of f between neighbouring nodes.
fn steepest<R: Real>(f: &[R]) -> R {
    let of_axis = |beside: usize| {
        let pairs = f.iter().zip(&f[beside..]).enumerate();
        let neighbours = pairs.filter(|(number, _)| number / beside % NODES < CELLS);
        // `max` of a NaN and a number is the number.
        neighbours.fold(R::zero(), |most, (_, (a, b))| most.max((*b - *a).abs()))
    };
    BESIDE.map(of_axis).into_iter().fold(R::zero(), R::max)
}
