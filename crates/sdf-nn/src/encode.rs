//! The encoding of a block of positions as features, and its derivatives.

use field::{Real, Vector3};

use crate::architecture::{Encoding, Transform};
use lanes::{GROUP, Group, Isa, LANES, Lane, Pass, Row, fma};

/// The map from points in world space to features: the transform, then the frequency encoding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Encoder<R: Real> {
    center: R::Vec3,
    inverse_radius: R,
    bands: usize,
}

impl<R: Lane> Encoder<R> {
    pub(crate) fn new(encoding: Encoding, transform: &Transform) -> Self {
        let center = <R::Vec3 as Vector3<R>>::of(transform.center);
        Encoder { center, inverse_radius: R::of(1.0 / transform.radius), bands: encoding.bands() }
    }

    /// Lengths of the unit ball per world unit.
    pub(crate) fn inverse_radius(&self) -> R {
        self.inverse_radius
    }

    /// Writes the features of at most `N` points. Lanes up to `N` without a point repeat the last
    /// point; the others keep old numbers.
    #[inline(always)]
    pub(crate) fn encode<I: Isa, const N: usize>(&self, x: &[R::Vec3], features: &mut [Row<R>]) {
        for l in 0..N {
            let y = ((x[l.min(x.len() - 1)] - self.center) * self.inverse_radius).to_array();
            for c in 0..3 {
                features[c].0[l] = y[c];
            }
        }
        I::call(Waves::<R, N> { bands: self.bands, features });
    }

    /// JVP of [`encode`](Self::encode): writes the tangents of the features as the points move
    /// along `p`, in the first `N` lanes.
    #[inline(always)]
    pub(crate) fn encode_jvp<I: Isa, const N: usize>(
        &self,
        p: &[R::Vec3],
        features: &[Row<R>],
        tangent: &mut [Row<R>],
    ) {
        for l in 0..N {
            let y = (p[l.min(p.len() - 1)] * self.inverse_radius).to_array();
            for c in 0..3 {
                tangent[c].0[l] = y[c];
            }
        }
        let (y_tangent, waves) = tangent.split_at_mut(3);
        for band in 0..self.bands {
            let frequency = R::Group::<I>::splat(R::of((1u64 << band) as f64));
            let minus = R::Group::<I>::splat(-R::of((1u64 << band) as f64));
            for c in 0..3 {
                let (sine, cosine) = (6 * band + c, 6 * band + 3 + c);
                for g in 0..N / GROUP {
                    let y: R::Group<I> = y_tangent[c].group(g);
                    waves[sine].set_group(g, frequency * y * features[3 + cosine].group(g));
                    waves[cosine].set_group(g, minus * y * features[3 + sine].group(g));
                }
            }
        }
    }

    /// VJP of [`encode`](Self::encode) to the points, times `factor`: `adjoint` holds the adjoints
    /// of the features.
    #[inline(always)]
    pub(crate) fn encode_vjp<I: Isa>(
        &self,
        features: &[Row<R>],
        adjoint: &[Row<R>],
        factor: R,
    ) -> [Row<R>; 3] {
        let mut out: [Row<R>; 3] = [adjoint[0], adjoint[1], adjoint[2]];
        I::call(WavesVjp { bands: self.bands, features, adjoint, out: &mut out });
        let factor = factor * self.inverse_radius;
        for out in &mut out {
            out.0.iter_mut().for_each(|v| *v *= factor);
        }
        out
    }

    /// VJP of [`encode_jvp`](Self::encode_jvp) to the points, times `factor`: adds to `out`.
    ///
    /// `adjoint` holds the adjoints of the features' tangents, `tangent` these tangents themselves.
    #[inline(always)]
    pub(crate) fn add_vjp_of_jvp<I: Isa>(
        &self,
        features: &[Row<R>],
        tangent: &[Row<R>],
        adjoint: &[Row<R>],
        factor: R,
        out: &mut [Row<R>; 3],
    ) {
        let factor = factor * self.inverse_radius;
        for band in 0..self.bands {
            let square = R::of(((1u64 << band) as f64).powi(2)) * factor;
            for (c, out) in out.iter_mut().enumerate() {
                let (sine, cosine) = (3 + 6 * band + c, 6 + 6 * band + c);
                for l in 0..LANES {
                    let curvature = adjoint[sine].0[l] * features[sine].0[l]
                        + adjoint[cosine].0[l] * features[cosine].0[l];
                    out.0[l] = fma::<R, I>(-square * tangent[c].0[l], curvature, out.0[l]);
                }
            }
        }
    }

    /// The factor of every feature from the weight of every octave; 1 for the coordinates.
    pub(crate) fn window(bands: &[R]) -> Vec<R> {
        let waves = bands.iter().flat_map(|w| [*w; 6]);
        [R::one(); 3].into_iter().chain(waves).collect()
    }
}

/// Lane `l` of three rows as a vector.
#[inline(always)]
pub(crate) fn lane<R: Real>(rows: &[Row<R>; 3], l: usize) -> R::Vec3 {
    R::Vec3::new(rows[0].0[l], rows[1].0[l], rows[2].0[l])
}

/// Sines and cosines of the coordinates in the first three rows, in the first `N` lanes.
struct Waves<'a, R, const N: usize> {
    bands: usize,
    features: &'a mut [Row<R>],
}

impl<R: Lane, const N: usize> Pass for Waves<'_, R, N> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (position, waves) = self.features.split_at_mut(3);
        for band in 0..self.bands {
            let frequency = R::of((1u64 << band) as f64);
            for c in 0..3 {
                let (sine, cosine) = (6 * band + c, 6 * band + 3 + c);
                for l in 0..N {
                    let (s, k) = R::sin_cos_moderate::<I>(frequency * position[c].0[l]);
                    waves[sine].0[l] = s;
                    waves[cosine].0[l] = k;
                }
            }
        }
    }
}

/// VJP of [`Waves`] to the coordinates: adds to `out`.
struct WavesVjp<'a, R> {
    bands: usize,
    features: &'a [Row<R>],
    adjoint: &'a [Row<R>],
    out: &'a mut [Row<R>; 3],
}

impl<R: Lane> Pass for WavesVjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let WavesVjp { bands, features, adjoint, out } = self;
        for band in 0..bands {
            let frequency = R::of((1u64 << band) as f64);
            for (c, out) in out.iter_mut().enumerate() {
                let (sine, cosine) = (3 + 6 * band + c, 6 + 6 * band + c);
                for l in 0..LANES {
                    let slope = adjoint[sine].0[l] * features[cosine].0[l]
                        - adjoint[cosine].0[l] * features[sine].0[l];
                    out.0[l] = fma::<R, I>(frequency, slope, out.0[l]);
                }
            }
        }
    }
}
