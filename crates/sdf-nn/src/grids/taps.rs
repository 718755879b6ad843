//! The weights of the coefficients of a group of points, and sums over them.

use field::Real;
use lanes::{GROUP, Group, Isa, Lane, Row, Sums, TableRows};

/// Points whose features are computed together.
#[derive(Clone, Debug)]
pub(crate) struct Points<R> {
    /// The points, by axis. Those after the first `count` are any others.
    pub(crate) y: [[R; GROUP]; 3],
    /// A vector for each point.
    pub(crate) p: [[R; GROUP]; 3],
    /// The number of points that are asked for.
    pub(crate) count: usize,
}

/// The features of a block of points, and their derivatives.
#[derive(Debug)]
pub(crate) struct Features<'a, R> {
    pub(crate) value: &'a mut [Row<R>],
    /// The gradients.
    pub(crate) slope: &'a mut [[Row<R>; 3]],
    /// The products of Hessians and vectors.
    pub(crate) bend: &'a mut [[Row<R>; 3]],
    /// The lane of the first point of the group.
    pub(crate) lane: usize,
    /// Working memory.
    pub(crate) sums: Sums<R>,
}

/// Adds a b to the lanes of a row from `lane` on.
#[inline(always)]
fn add_product<R: Lane, V: Group<R>>(row: &mut Row<R>, lane: usize, a: V, b: V) {
    let g = lane / GROUP;
    row.set_group(g, V::fma(a, b, row.group(g)));
}

impl<R: Lane> Features<'_, R> {
    /// Sets the features of a level to zero, up to the derivatives of an order.
    #[inline(always)]
    fn clear<const ORDER: usize>(&mut self, first: usize, count: usize) {
        let lanes = self.lane..self.lane + GROUP;
        for f in first..first + count {
            self.value[f].0[lanes.clone()].fill(R::zero());
            if ORDER >= 1 {
                self.slope[f].iter_mut().for_each(|row| row.0[lanes.clone()].fill(R::zero()));
            }
            if ORDER >= 2 {
                self.bend[f].iter_mut().for_each(|row| row.0[lanes.clone()].fill(R::zero()));
            }
        }
    }

    /// Adds the sums of entry `e` to feature `f`. `z` has the weights of its coefficients along z,
    /// by order.
    #[inline(always)]
    fn add<V: Group<R>, const ORDER: usize>(
        &mut self,
        f: usize,
        e: usize,
        z: [V; 3],
        p: &[[R; GROUP]; 3],
    ) {
        let (lane, sums) = (self.lane, &self.sums);
        let value = V::load(&sums[0][e]);
        add_product(&mut self.value[f], lane, value, z[0]);
        if ORDER == 0 {
            return;
        }
        let (x, y, slope) = (V::load(&sums[1][e]), V::load(&sums[2][e]), &mut self.slope[f]);
        add_product(&mut slope[0], lane, x, z[0]);
        add_product(&mut slope[1], lane, y, z[0]);
        add_product(&mut slope[2], lane, value, z[1]);
        if ORDER == 1 {
            return;
        }
        let (xx, xy, yy) = (V::load(&sums[3][e]), V::load(&sums[4][e]), V::load(&sums[5][e]));
        let ([px, py, pz], bend) =
            ([V::load(&p[0]), V::load(&p[1]), V::load(&p[2])], &mut self.bend[f]);
        add_product(&mut bend[0], lane, V::fma(xx, px, xy * py), z[0]);
        add_product(&mut bend[0], lane, x * pz, z[1]);
        add_product(&mut bend[1], lane, V::fma(xy, px, yy * py), z[0]);
        add_product(&mut bend[1], lane, y * pz, z[1]);
        add_product(&mut bend[2], lane, V::fma(x, px, y * py), z[1]);
        add_product(&mut bend[2], lane, value * pz, z[2]);
    }
}

/// The places of a group of points along an axis of a level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places<V> {
    /// The index of the first coefficient.
    pub(crate) first: [u32; GROUP],
    /// The place in the interval, from 0 to 1.
    t: V,
    /// Intervals per unit; 0 beside the cube.
    scale: V,
}

impl<V> Places<V> {
    /// The places of coordinates, in a level with `side` coefficients along a side and `taps` of
    /// them for a value. Beside the cube, the place is that of the nearest point of the cube.
    #[inline(always)]
    pub(crate) fn new<R: Real>(coordinates: &[R; GROUP], side: usize, taps: usize) -> Self
    where
        V: Group<R>,
    {
        let cells = side + 1 - taps;
        let scale: V = of(0.5 * cells as f64);
        let place = (V::load(coordinates) + of(1.0)) * scale;
        let inside = place.clamp(of(cells as f64));
        let (mut first, whole) = inside.truncate();
        // The last place of the last interval has the next integer.
        first.iter_mut().for_each(|first| *first = (*first).min(cells as u32 - 1));
        let t = inside - whole.min(of((cells - 1) as f64));
        Places { first, t, scale: scale.where_equal(place, inside) }
    }

    /// The weights of the coefficients of each point, by order of the derivative, up to `ORDER`.
    /// Beside the cube, there are no derivatives.
    #[inline(always)]
    pub(crate) fn weights<R: Real, const T: usize, const ORDER: usize>(&self) -> [[V; T]; 3]
    where
        V: Group<R>,
    {
        let of_point = if T == 3 { quadratic::<R, V>(self.t) } else { cubic::<R, V>(self.t) };
        let mut weights = [[V::splat(R::zero()); T]; 3];
        for tap in 0..T {
            weights[0][tap] = of_point[0][tap];
            if ORDER >= 1 {
                weights[1][tap] = of_point[1][tap] * self.scale;
            }
            if ORDER >= 2 {
                weights[2][tap] = of_point[2][tap] * (self.scale * self.scale);
            }
        }
        weights
    }
}

/// A number for all points. A closure is not always inlined, and is then not compiled for the
/// vector instructions.
#[inline(always)]
fn of<R: Real, V: Group<R>>(value: f64) -> V {
    V::splat(R::of(value))
}

/// The weights of quadratic splines, by order of the derivative.
#[inline(always)]
fn quadratic<R: Real, V: Group<R>>(t: V) -> [[V; 4]; 3] {
    let (half, one, zero): (V, V, V) = (of(0.5), of(1.0), of(0.0));
    let u = one - t;
    [
        [half * u * u, V::fma(t, u, half), half * t * t, zero],
        [zero - u, u - t, t, zero],
        [one, of(-2.0), one, zero],
    ]
}

/// The weights of cubic splines, by order of the derivative.
#[inline(always)]
fn cubic<R: Real, V: Group<R>>(t: V) -> [[V; 4]; 3] {
    let (half, one, sixth): (V, V, V) = (of(0.5), of(1.0), of(1.0 / 6.0));
    let (two, three, minus): (V, V, V) = (of(2.0), of(3.0), of(-0.5));
    let (two_thirds, steep): (V, V) = (of(2.0 / 3.0), of(1.5));
    let u = one - t;
    [
        [
            sixth * u * u * u,
            two_thirds - t * t * (one - half * t),
            two_thirds - u * u * (one - half * u),
            sixth * t * t * t,
        ],
        [minus * u * u, t * (steep * t - two), u * (two - steep * u), half * t * t],
        [u, three * t - two, three * u - two, t],
    ]
}

/// Weights as numbers.
#[inline(always)]
pub(crate) fn stored<R: Real, V: Group<R>, const T: usize, const ORDER: usize>(
    weights: &[[V; T]; 3],
) -> [[[R; GROUP]; T]; 3] {
    let mut stored = [[[R::zero(); GROUP]; T]; 3];
    for order in 0..=ORDER {
        for tap in 0..T {
            weights[order][tap].store(&mut stored[order][tap]);
        }
    }
    stored
}

/// The number of entries that a table has after all coefficients, since rows are read whole.
pub const PADDING: usize = GROUP;

/// The coefficients of a level: rows along z.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    pub(crate) side: usize,
    /// The index of the first coefficient.
    pub(crate) start: usize,
    pub(crate) features: usize,
}

impl Rows {
    /// The first node of each point.
    #[inline(always)]
    pub(crate) fn nodes<V>(&self, [x, y, z]: &[Places<V>; 3]) -> [usize; GROUP] {
        let mut nodes = [0; GROUP];
        for l in 0..GROUP {
            let [x, y, z] = [x.first[l], y.first[l], z.first[l]].map(|i| i as usize);
            nodes[l] = (x * self.side + y) * self.side + z;
        }
        nodes
    }

    /// Writes the features of a group from the number `first` on. `met` has a bit for each point
    /// with a free node; the features of others are zero.
    #[inline(always)]
    pub(crate) fn write<R: Lane, I: Isa, const T: usize, const ORDER: usize>(
        &self,
        table: &[R],
        axes: &[Places<R::Group<I>>; 3],
        (met, p): (u32, &[[R; GROUP]; 3]),
        first: usize,
        out: &mut Features<'_, R>,
    ) {
        let count = self.features;
        out.clear::<ORDER>(first, count);
        if met == 0 {
            return;
        }
        let [x, y, z] = axes;
        let weights = [x.weights::<R, T, ORDER>(), y.weights::<R, T, ORDER>()];
        let [x, y] = [stored::<_, _, T, ORDER>(&weights[0]), stored::<_, _, T, ORDER>(&weights[1])];
        let z = z.weights::<R, T, ORDER>();
        let steps = [self.side * self.side * count, self.side * count];
        let mut places = self.nodes(axes);
        places.iter_mut().for_each(|place| *place = self.start + *place * count);
        let (mut tap, mut f) = (0, 0);
        for start in (0..T * count).step_by(GROUP) {
            let rows = TableRows { table, places: &places, met, steps, weights: [&x, &y] };
            R::sum_rows::<I, T, ORDER>(&rows, &mut out.sums);
            for e in 0..GROUP.min(T * count - start) {
                let weights = [z[0][tap], z[1][tap], z[2][tap]];
                out.add::<_, ORDER>(first + f, e, weights, p);
                f += 1;
                if f == count {
                    (tap, f) = (tap + 1, 0);
                }
            }
            places.iter_mut().for_each(|place| *place += GROUP);
        }
    }
}
