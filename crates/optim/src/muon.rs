//! Steps of matrices along orthogonal matrices.

use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, ArrayView2, LinalgScalar};
use num_traits::Float;

use crate::group::{Group, constant};

/// The coefficients of x ↦ a x + b x³ + c x⁵. Applied five times, it takes each singular value in
/// [0.01, 1] to within about 0.3 of 1.
const POLYNOMIAL: [f64; 3] = [3.4445, -4.7750, 2.0315];

/// The times that the polynomial is applied.
const ROUNDS: usize = 5;

/// The root mean square of a step, in learning rates: about that of a step of Adam.
const STEP: f64 = 0.2;

/// Takes a step of a group that is a matrix of this many columns. `p`, `g` and `m` are its
/// parameters, its gradient and the running mean of its gradient, row-major.
pub(crate) fn step<R: Float + LinalgScalar>(
    group: &Group,
    columns: usize,
    rate: R,
    p: &mut [R],
    (g, m): (&[R], &mut [R]),
) {
    let [beta, fresh] = [group.beta1, 1.0 - group.beta1].map(constant::<R>);
    m.iter_mut().zip(g).for_each(|(m, g)| *m = beta * *m + fresh * *g);
    // Nesterov's momentum: the mean as it will be if the next gradient is this one.
    let ahead: Vec<R> = m.iter().zip(g).map(|(m, g)| beta * *m + fresh * *g).collect();
    let rows = p.len() / columns;
    let Ok(ahead) = ArrayView2::from_shape((rows, columns), &ahead) else { return };
    // A wide matrix has the smaller Gram matrix.
    let turned = if rows > columns {
        orthogonal(ahead.reversed_axes()).reversed_axes()
    } else {
        orthogonal(ahead)
    };
    let longer = constant::<R>(rows.max(columns) as f64).sqrt();
    let length = rate * constant(group.rate * STEP) * longer;
    let decay = rate * constant(group.weight_decay);
    let steps = turned.iter();
    p.iter_mut().zip(steps).for_each(|(p, step)| *p = *p - length * *step - decay * *p);
}

/// About U Vᵀ of the singular value decomposition U Σ Vᵀ of a matrix with as many columns as rows
/// or more: singular values far below the norm become smaller, and others lie between 0.7 and 1.3.
/// Zero for zero.
fn orthogonal<R: Float + LinalgScalar>(matrix: ArrayView2<'_, R>) -> Array2<R> {
    let norm = matrix.iter().fold(R::zero(), |sum, v| sum + *v * *v).sqrt();
    if norm == R::zero() {
        return matrix.to_owned();
    }
    let [a, b, c] = POLYNOMIAL.map(constant::<R>);
    let mut x = matrix.mapv(|v| v / norm);
    let rows = x.nrows();
    let (mut gram, mut next) = (Array2::zeros((rows, rows)), x.clone());
    let mut polynomial = gram.clone();
    for _ in 0..ROUNDS {
        general_mat_mul(R::one(), &x, &x.t(), R::zero(), &mut gram);
        polynomial.assign(&gram);
        general_mat_mul(c, &gram, &gram, b, &mut polynomial);
        next.assign(&x);
        general_mat_mul(R::one(), &polynomial, &x, a, &mut next);
        std::mem::swap(&mut x, &mut next);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn singular_vectors_stay_and_singular_values_become_one(
            angles in prop::array::uniform2(0.0f64..6.3),
            values in prop::array::uniform2(0.02f64..1.0),
            scale in 1e-8f64..1e8,
        ) {
            // A matrix of 2 × 2 with these singular vectors.
            let turn = |a: f64| [[a.cos(), -a.sin()], [a.sin(), a.cos()]];
            let (u, v) = (turn(angles[0]), turn(angles[1]));
            let with = |s: [f64; 2]| {
                Array2::from_shape_fn((2, 2), |(i, j)| {
                    (0..2).map(|k| scale * u[i][k] * s[k] * v[j][k]).sum::<f64>()
                })
            };
            let found = orthogonal(with(values).view());
            // u_kᵀ X v_l: the singular values on the diagonal.
            let at = |k: usize, l: usize| {
                (0..2).flat_map(|i| (0..2).map(move |j| (i, j)))
                    .map(|(i, j)| u[i][k] * found[(i, j)] * v[j][l])
                    .sum::<f64>()
            };
            for k in 0..2 {
                prop_assert!((0.5..1.5).contains(&at(k, k)), "{found}");
                prop_assert!(at(k, 1 - k).abs() < 1e-9, "{found}");
            }
        }
    }
}
