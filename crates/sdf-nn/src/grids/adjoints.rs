//! The adjoints of the coefficients of a group of points.

use field::TableSum;
use lanes::{GROUP, Group, Isa, Lane, Row};

use crate::grids::support::{Run, Support};
use crate::grids::taps::{Places, Rows};

/// The adjoints of features of a block of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bars<'a, R> {
    /// Those of the values, and those of the gradients along the vectors of the points.
    pub(crate) sides: [&'a [Row<R>]; 2],
    /// The lane of the first point of the group.
    pub(crate) lane: usize,
}

impl<R: Lane> Bars<'_, R> {
    /// The same of `count` features from the number `first` on.
    #[inline(always)]
    pub(crate) fn of(&self, first: usize, count: usize) -> Self {
        Bars { sides: self.sides.map(|rows| &rows[first..first + count]), lane: self.lane }
    }

    /// Those of a feature.
    #[inline(always)]
    fn of_feature<V: Group<R>>(&self, f: usize) -> [V; 2] {
        let g = self.lane / GROUP;
        [self.sides[0][f].group(g), self.sides[1][f].group(g)]
    }

    /// The points with adjoints that are not all zero, as bits.
    #[inline(always)]
    pub(crate) fn met(&self) -> u32 {
        let mut met = [false; GROUP];
        for row in self.sides.iter().copied().flatten() {
            for l in 0..GROUP {
                met[l] |= row.0[self.lane + l] != R::zero();
            }
        }
        (0..GROUP).fold(0, |bits, l| bits | u32::from(met[l]) << l)
    }
}

/// What the coefficients of an entry of the rows have of the value and of the slope along p, for
/// each point: factors of wx wy, and of its change along p. By point, then by entry.
#[derive(Clone, Copy)]
struct Entries<R> {
    flat: [[R; GROUP]; GROUP],
    steep: [[R; GROUP]; GROUP],
}

impl Rows {
    /// Adds the adjoints of the coefficients of the points of `met`, of which it has bits. The
    /// coefficients of the level that are free start at `start`, which is even for two features.
    #[inline(always)]
    pub(crate) fn add<R: Lane, I: Isa, const T: usize>(
        &self,
        support: &Support,
        axes: &[Places<R::Group<I>>; 3],
        (met, p): (u32, &[[R; GROUP]; 3]),
        bars: Bars<'_, R>,
        sums: &mut TableSum<'_, R>,
    ) {
        let [x, y, z] = axes;
        // No `map`: see `of` in `taps`.
        let [x, y] = [x.weights::<R, T, 1>(), y.weights::<R, T, 1>()];
        let z = z.weights::<R, T, 1>();
        let [px, py, pz] =
            [R::Group::<I>::load(&p[0]), R::Group::<I>::load(&p[1]), R::Group::<I>::load(&p[2])];
        // A coefficient has wx wy wz of the value and ∇(wx wy wz)·p of the slope along p.
        let (mut both, mut moved) = ([[[R::zero(); GROUP]; T]; T], [[[R::zero(); GROUP]; T]; T]);
        for i in 0..T {
            let along = x[1][i] * px;
            for j in 0..T {
                (x[0][i] * y[0][j]).store(&mut both[i][j]);
                R::Group::<I>::fma(along, y[0][j], x[0][i] * (y[1][j] * py))
                    .store(&mut moved[i][j]);
            }
        }
        let nodes = self.nodes(axes);
        for start in (0..T * self.features).step_by(GROUP) {
            let entries = self.entries::<R, R::Group<I>, T>(start, [&z[0], &z[1]], pz, bars);
            for point in (0..GROUP).filter(|point| met >> point & 1 == 1) {
                let flat = R::Group::<I>::load(&entries.flat[point]);
                let steep = R::Group::<I>::load(&entries.steep[point]);
                for i in 0..T {
                    for j in 0..T {
                        let node = nodes[point] + (i * self.side + j) * self.side;
                        let run = support.run::<T>(node);
                        if run.is_free == 0 {
                            continue;
                        }
                        let both = R::Group::<I>::splat(both[i][j][point]);
                        let moved = R::Group::<I>::splat(moved[i][j][point]);
                        let mut row = [R::zero(); GROUP];
                        R::Group::<I>::fma(both, flat, moved * steep).store(&mut row);
                        self.add_row::<R, T>(start, run, &row, sums);
                    }
                }
            }
        }
    }

    /// The factors of the entries from `start` on.
    #[inline(always)]
    fn entries<R: Lane, V: Group<R>, const T: usize>(
        &self,
        start: usize,
        z: [&[V; T]; 2],
        p: V,
        bars: Bars<'_, R>,
    ) -> Entries<R> {
        let zeros = [[R::zero(); GROUP]; GROUP];
        let mut entries = Entries { flat: zeros, steep: zeros };
        let (mut tap, mut f) = (start / self.features, start % self.features);
        for e in 0..GROUP.min(T * self.features - start) {
            let [value, along] = bars.of_feature::<V>(f);
            let (mut flat, mut steep) = ([R::zero(); GROUP], [R::zero(); GROUP]);
            V::fma(value, z[0][tap], along * (z[1][tap] * p)).store(&mut flat);
            (along * z[0][tap]).store(&mut steep);
            for l in 0..GROUP {
                entries.flat[l][e] = flat[l];
                entries.steep[l][e] = steep[l];
            }
            f += 1;
            if f == self.features {
                (tap, f) = (tap + 1, 0);
            }
        }
        entries
    }

    /// Adds the entries of a row from `start` on to the free coefficients among them.
    #[inline(always)]
    fn add_row<R: Lane, const T: usize>(
        &self,
        start: usize,
        Run { is_free, slot }: Run,
        row: &[R; GROUP],
        sums: &mut TableSum<'_, R>,
    ) {
        let count = self.features;
        let at = self.start + slot * count;
        if count == 2 {
            let (pairs, _) = row.as_chunks::<2>();
            // The coefficients of nodes that are all free follow each other.
            if is_free == (1 << T) - 1 {
                sums.add_pairs::<T>(at, pairs);
                return;
            }
            let mut at = at;
            for z in (0..T).filter(|z| is_free >> z & 1 == 1) {
                sums.add_pair(at, pairs[z]);
                at += 2;
            }
            return;
        }
        for (e, value) in (start..T * count).zip(row) {
            let (z, f) = (e / count, e % count);
            if is_free >> z & 1 == 1 {
                let before = (is_free & ((1 << z) - 1)).count_ones() as usize;
                sums.add_at(at + before * count + f, *value);
            }
        }
    }
}
