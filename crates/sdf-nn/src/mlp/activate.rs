//! The activation functions on rows of lanes.

use crate::architecture::Activation;
use lanes::{Isa, Lane, Pass, Row};

/// The activation of all rows of a layer, first `N` lanes only.
pub(super) struct Activate<'a, R, const N: usize, const STORE: bool, const TANGENT: bool> {
    pub(super) activation: Activation,
    /// Row g of point p is row g × `points` + p.
    pub(super) z: &'a [Row<R>],
    pub(super) points: usize,
    /// σ(z): row g of point p is row p × `stride` + g.
    pub(super) value: &'a mut [Row<R>],
    pub(super) stride: usize,
    /// With `STORE`, σ′(z) in the order of `z`.
    pub(super) slope: &'a mut [Row<R>],
    /// With `STORE` and `TANGENT`, σ″(z) in the order of `z`.
    pub(super) curvature: &'a mut [Row<R>],
}

impl<R: Lane, const N: usize, const STORE: bool, const TANGENT: bool> Pass
    for Activate<'_, R, N, STORE, TANGENT>
{
    #[inline(always)]
    fn run<I: Isa>(self) {
        // Rows for derivatives that the flags leave out.
        let mut unused = [Row::zero(); 2];
        for p in 0..self.points {
            for g in 0..self.z.len() / self.points {
                let row = g * self.points + p;
                let (z, value) = (&self.z[row], &mut self.value[p * self.stride + g]);
                let [slope, curvature] = &mut unused;
                let slope = if STORE { &mut self.slope[row] } else { slope };
                let curvature = if TANGENT { &mut self.curvature[row] } else { curvature };
                match self.activation {
                    Activation::Softplus { beta } => {
                        let out = [value, slope, curvature];
                        R::softplus::<I, N, STORE, TANGENT>(beta, z, out);
                    }
                    Activation::Sine { omega } => {
                        sine::<R, I, N, STORE, TANGENT>(omega, z, value, slope, curvature);
                    }
                    Activation::Relu => relu::<R, N, STORE, TANGENT>(z, value, slope, curvature),
                }
            }
        }
    }
}

/// σ(z) = sin(ω z).
#[inline(always)]
fn sine<R: Lane, I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
    omega: f64,
    z: &Row<R>,
    value: &mut Row<R>,
    slope: &mut Row<R>,
    curvature: &mut Row<R>,
) {
    let omega = R::of(omega);
    for i in 0..N {
        let (sine, cosine) = R::sin_cos_moderate::<I>(omega * z.0[i]);
        value.0[i] = sine;
        if STORE {
            slope.0[i] = omega * cosine;
        }
        if TANGENT {
            curvature.0[i] = -omega * omega * sine;
        }
    }
}

/// σ(z) = max(0, z), and NaN for NaN. The slope at 0 is set to 0.
#[inline(always)]
fn relu<R: Lane, const N: usize, const STORE: bool, const TANGENT: bool>(
    z: &Row<R>,
    value: &mut Row<R>,
    slope: &mut Row<R>,
    curvature: &mut Row<R>,
) {
    for i in 0..N {
        let on = z.0[i] > R::zero();
        value.0[i] = if z.0[i] <= R::zero() { R::zero() } else { z.0[i] };
        if STORE {
            slope.0[i] = if on { R::one() } else { R::zero() };
        }
        if TANGENT {
            curvature.0[i] = R::zero();
        }
    }
}
