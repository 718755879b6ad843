//! Rows of a softplus, whose registers are computed step by step together: each waits for the
//! result of the step before.

use std::f32::consts::{LN_2, LOG2_E};

use super::vector::Vector;
use crate::block::{Row, Softplus};
use crate::single::{EXPONENTIAL, LOGARITHM, MOST, ROUND_SINGLE};

/// The most registers of a row.
const MOST_REGISTERS: usize = 4;

/// Numbers of a row; those after the first `N` / `V::N` are not used.
type Registers<V> = [V; MOST_REGISTERS];

/// A polynomial with these coefficients, the highest order first.
#[inline(always)]
fn polynomial<V: Vector, const N: usize>(coefficients: &[f32], x: &Registers<V>) -> Registers<V> {
    let mut sums = [V::splat(coefficients[0]); MOST_REGISTERS];
    for c in &coefficients[1..] {
        for v in 0..N / V::N {
            sums[v] = V::fma(sums[v], x[v], V::splat(*c));
        }
    }
    sums
}

/// exp(−x): see [`exp_negative`](crate::single::exp_negative).
#[inline(always)]
fn exp_negative<V: Vector, const N: usize>(x: &Registers<V>) -> Registers<V> {
    let mut shifted = [V::splat(0.0); MOST_REGISTERS];
    let mut r = shifted;
    for v in 0..N / V::N {
        shifted[v] = V::fma(x[v], V::splat(-LOG2_E), V::splat(ROUND_SINGLE));
    }
    for v in 0..N / V::N {
        let n = V::sub(shifted[v], V::splat(ROUND_SINGLE));
        r[v] = V::fused_difference(n, V::splat(-LN_2), x[v]);
    }
    let mut p = polynomial::<V, N>(&EXPONENTIAL, &r);
    for v in 0..N / V::N {
        p[v] = V::scale(p[v], shifted[v]);
    }
    p
}

/// [`Lane::softplus`](crate::Lane::softplus), with the bits of its portable form.
#[inline(always)]
pub(super) fn softplus<V: Vector, const N: usize, const STORE: bool, const TANGENT: bool>(
    beta: f64,
    z: &Row<f32>,
    [value, slope, curvature]: Softplus<'_, f32>,
) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let (inverse, beta) = (V::splat((1.0 / beta) as f32), V::splat(beta as f32));
    let mut x = [zero; MOST_REGISTERS];
    for v in 0..N / V::N {
        let z = V::load(&z.0[v * V::N..]);
        x[v] = V::min(V::mul(beta, V::abs(z)), V::splat(MOST));
    }
    let e = exp_negative::<V, N>(&x);
    let p = polynomial::<V, N>(&LOGARITHM, &e);
    for v in 0..N / V::N {
        let z = V::load(&z.0[v * V::N..]);
        let ln = V::mul(e[v], p[v]);
        // x of a NaN is a number. This is the NaN.
        let positive_part = V::max(zero, z);
        V::fma(ln, inverse, positive_part).store(&mut value.0[v * V::N..]);
        if STORE {
            let high = V::div(one, V::add(one, e[v]));
            let low = V::mul(e[v], high);
            V::where_positive(z, high, low).store(&mut slope.0[v * V::N..]);
            if TANGENT {
                V::mul(V::mul(beta, high), low).store(&mut curvature.0[v * V::N..]);
            }
        }
    }
}
