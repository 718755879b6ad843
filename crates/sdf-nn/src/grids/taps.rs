//! The weights of the coefficients of a point, and sums over them.

use field::{Real, TableSum};

/// A feature at a point: its value, gradient, and the product of its Hessian and a vector. Those
/// of a higher order than was asked for are zero.
#[derive(Clone, Copy, Debug, Default)]
pub struct Jet<R> {
    /// The value.
    pub value: R,
    /// The gradient by the point.
    pub slope: [R; 3],
    /// The Hessian times the vector.
    pub bend: [R; 3],
}

/// The weights along an axis of the coefficients of a point, by order of the derivative.
pub(crate) struct Axis<R, const T: usize> {
    /// The index of the first coefficient.
    pub(crate) first: usize,
    weights: [[R; T]; 3],
}

impl<R: Real, const T: usize> Axis<R, T> {
    /// The weights for a coordinate, of a level with `side` coefficients along a side. Beside the
    /// cube, the weights are those of the nearest point of the cube, without derivatives.
    #[inline(always)]
    pub(crate) fn new(coordinate: R, side: usize) -> Self {
        let cells = side + 1 - T;
        let most = R::of(cells as f64);
        let scale = R::of(0.5 * cells as f64);
        let place = (coordinate + R::one()) * scale;
        let inside = place.max(R::zero()).min(most);
        let first = inside.to_usize().unwrap_or(0).min(cells - 1);
        let t = inside - R::of(first as f64);
        let (scale, half, one) =
            (if place == inside { scale } else { R::zero() }, R::of(0.5), R::one());
        let u = one - t;
        let mut weights = [[R::zero(); T]; 3];
        if T == 3 {
            weights[0][..3].copy_from_slice(&[half * u * u, half + t * u, half * t * t]);
            weights[1][..3].copy_from_slice(&[-u, u - t, t]);
            weights[2][..3].copy_from_slice(&[one, R::of(-2.0), one]);
        } else {
            let (sixth, two_thirds) = (R::of(1.0 / 6.0), R::of(2.0 / 3.0));
            let middle = |t: R| two_thirds - t * t * (one - half * t);
            weights[0][..4].copy_from_slice(&[
                sixth * u * u * u,
                middle(t),
                middle(u),
                sixth * t * t * t,
            ]);
            let slope = |t: R| t * (R::of(1.5) * t - R::of(2.0));
            weights[1][..4].copy_from_slice(&[-half * u * u, slope(t), -slope(u), half * t * t]);
            weights[2][..4].copy_from_slice(&[
                u,
                R::of(3.0) * t - R::of(2.0),
                R::of(3.0) * u - R::of(2.0),
                t,
            ]);
        }
        let [_, slopes, bends] = &mut weights;
        slopes.iter_mut().for_each(|w| *w *= scale);
        bends.iter_mut().for_each(|w| *w *= scale * scale);
        Axis { first, weights }
    }

    /// The weights of coefficient number `i`.
    #[inline(always)]
    fn of(&self, i: usize) -> [R; 3] {
        [self.weights[0][i], self.weights[1][i], self.weights[2][i]]
    }
}

// Loops in place of `map` and `from_fn` of arrays: those are not always inlined, and are then not
// compiled for the vector instructions of the caller.

/// The sums of products of a row with weights, for each of `G` features.
#[inline(always)]
fn dot<R: Real, const W: usize, const G: usize>(row: &[R; W], weights: &[R; W]) -> [R; G] {
    let (mut products, mut sums) = ([R::zero(); W], [R::zero(); G]);
    for k in 0..W {
        products[k] = row[k] * weights[k];
    }
    for k in 0..W {
        sums[k % G] += products[k];
    }
    sums
}

/// The numbers of entries of a row: coefficients along z times features at once.
const ROW: usize = 16;

/// The number of entries that a table has after all coefficients, since rows are read whole.
pub const PADDING: usize = ROW;

/// The coefficients of a level: rows along z.
#[derive(Clone, Copy)]
pub(crate) struct Rows {
    pub(crate) side: usize,
    pub(crate) start: usize,
    pub(crate) features: usize,
}

impl Rows {
    /// The first node of a row.
    #[inline(always)]
    fn node<R, const T: usize>(&self, axes: &[Axis<R, T>; 3], i: usize, j: usize) -> usize {
        let [x, y, z] = axes;
        ((x.first + i) * self.side + y.first + j) * self.side + z.first
    }

    /// The jets of `G` features from the number `f` on. `W` is a number of entries of at least
    /// T G: a row is a vector of so many.
    #[inline(always)]
    pub(crate) fn jets<
        R: Real,
        const T: usize,
        const G: usize,
        const W: usize,
        const ORDER: usize,
    >(
        &self,
        coefficients: &[R],
        f: usize,
        axes: &[Axis<R, T>; 3],
        p: [R; 3],
    ) -> [Jet<R>; G] {
        // Sums over x and y, for the derivatives none, x, y, xx, xy, yy.
        let mut sums = [[R::zero(); W]; 6];
        let kinds = [1, 3, 6][ORDER];
        for i in 0..T {
            for j in 0..T {
                let at = self.start + self.node(axes, i, j) * self.features + f;
                let mut row = [R::zero(); W];
                if self.features == G {
                    row.copy_from_slice(&coefficients[at..at + W]);
                } else {
                    for k in 0..T * G {
                        row[k] = coefficients[at + k / G * self.features + k % G];
                    }
                }
                let (x, y) = (axes[0].of(i), axes[1].of(j));
                let factors =
                    [x[0] * y[0], x[1] * y[0], x[0] * y[1], x[2] * y[0], x[1] * y[1], x[0] * y[2]];
                for (sum, factor) in sums[..kinds].iter_mut().zip(factors) {
                    (0..W).for_each(|k| sum[k] += factor * row[k]);
                }
            }
        }
        // Entries after the last coefficient have the weight 0. They are computed all the same, so
        // that the compiler takes one vector for a row.
        let mut weights = [[R::zero(); W]; 3];
        for (weights, of_row) in weights.iter_mut().zip(&axes[2].weights) {
            for k in 0..T * G {
                weights[k] = of_row[k / G];
            }
        }
        let along = |kind: usize, order: usize| dot::<R, W, G>(&sums[kind], &weights[order]);
        let value = along(0, 0);
        let mut jets = [Jet::default(); G];
        for g in 0..G {
            jets[g].value = value[g];
        }
        if ORDER >= 1 {
            let [x, y, z] = [along(1, 0), along(2, 0), along(0, 1)];
            for g in 0..G {
                jets[g].slope = [x[g], y[g], z[g]];
            }
        }
        if ORDER >= 2 {
            let [xx, xy, yy] = [along(3, 0), along(4, 0), along(5, 0)];
            let [xz, yz, zz] = [along(1, 1), along(2, 1), along(0, 2)];
            for g in 0..G {
                jets[g].bend = [
                    xx[g] * p[0] + xy[g] * p[1] + xz[g] * p[2],
                    xy[g] * p[0] + yy[g] * p[1] + yz[g] * p[2],
                    xz[g] * p[0] + yz[g] * p[1] + zz[g] * p[2],
                ];
            }
        }
        jets
    }

    /// Adds the adjoints of the coefficients of `G` features from the number `f` on. `slot` is the
    /// number of a node among the free ones, if it is free. For two features, `f` and the start of
    /// the level are even.
    #[inline(always)]
    pub(crate) fn add<R: Real, const T: usize, const G: usize>(
        &self,
        sums: &mut TableSum<'_, R>,
        f: usize,
        axes: &[Axis<R, T>; 3],
        p: [R; 3],
        bars: [[R; 2]; G],
        slot: impl Fn(usize) -> Option<usize>,
    ) {
        // A coefficient has wx wy wz of the value and ∇(wx wy wz)·p of the slope along p.
        let (mut flat, mut steep) = ([R::zero(); ROW], [R::zero(); ROW]);
        for z in 0..T {
            let [w, slope] = [axes[2].weights[0][z], axes[2].weights[1][z] * p[2]];
            for (g, [value, along]) in bars.iter().enumerate() {
                flat[z * G + g] = *value * w + *along * slope;
                steep[z * G + g] = *along * w;
            }
        }
        for i in 0..T {
            for j in 0..T {
                let node = self.node(axes, i, j);
                let (x, y) = (axes[0].of(i), axes[1].of(j));
                let both = x[0] * y[0];
                let moved = x[1] * p[0] * y[0] + x[0] * y[1] * p[1];
                for z in 0..T {
                    let Some(slot) = slot(node + z) else { continue };
                    let at = self.start + slot * self.features + f;
                    let bar = |g: usize| both * flat[z * G + g] + moved * steep[z * G + g];
                    if G == 2 {
                        sums.add_pair(at, [bar(0), bar(1)]);
                    } else {
                        (0..G).for_each(|g| sums.add_at(at + g, bar(g)));
                    }
                }
            }
        }
    }
}
