//! Opacity of the intervals of a ray from values of f at their ends.
//!
//! Wang, Liu, Liu, Theobalt, Komura and Wang, "NeuS: Learning Neural Implicit Surfaces by Volume
//! Rendering for Multi-view Reconstruction", NeurIPS 2021, section 3.1: with Φ(f) = sigmoid(s f),
//! an interval on which f falls from f₀ to f₁ has the opacity 1 − Φ(f₁)/Φ(f₀). Where f rises it has
//! none, so only the first of two surfaces is seen.

use field::Real;

/// ln sigmoid(x).
fn ln_sigmoid<R: Real>(x: R) -> R {
    x.min(R::zero()) - (-x.abs()).exp().ln_1p()
}

/// The transmittance of an interval, at most 1. By logarithms: Φ is 0 in single precision deep
/// inside the solid.
pub(crate) fn transmittance<R: Real>(sharpness: R, [from, to]: [R; 2]) -> R {
    (ln_sigmoid(sharpness * to) - ln_sigmoid(sharpness * from)).min(R::zero()).exp()
}

/// Computes the weights of the intervals of a ray, and returns the transmittance behind all of
/// them. `f` has the values at the ends of the intervals, in order.
///
/// An interval whose weight would not be above `least` is empty: its weight is 0, and it hides
/// nothing.
pub fn weights<R: Real>(sharpness: R, f: &[R], least: R, weights: &mut [R]) -> R {
    let mut before = R::one();
    for (weight, f) in weights.iter_mut().zip(f.windows(2)) {
        let pass = transmittance(sharpness, [f[0], f[1]]);
        let own = before * (R::one() - pass);
        *weight = if own > least { own } else { R::zero() };
        before -= *weight;
    }
    before
}

/// The reverse mode of a ray's radiance Σ w c + T B by the values of f.
///
/// `radiance` has δ·c of every interval; `last` is the transmittance behind all of them, and
/// `behind` is δ·B. The adjoints of f are added to `bars`.
pub fn value_vjp<R: Real>(
    sharpness: R,
    f: &[R],
    weights: &[R],
    (last, behind): (R, R),
    radiance: &[R],
    bars: &mut [R],
) {
    let slope = |f: R| sharpness * (R::one() - (R::one() + (-sharpness * f).exp()).recip());
    // The radiance behind an interval times δ, and the transmittance behind it.
    let (mut rest, mut after) = (behind * last, last);
    for k in (0..weights.len()).rev() {
        if weights[k] > R::zero() {
            let bar = rest - radiance[k] * after;
            bars[k] -= bar * slope(f[k]);
            bars[k + 1] += bar * slope(f[k + 1]);
        }
        rest += radiance[k] * weights[k];
        after += weights[k];
    }
}

/// The radiance Σ w c + T B of a ray: `last` is the transmittance T behind all intervals, and
/// `behind` is B.
pub fn radiance<R: Real>(
    weights: &[R],
    colors: impl Iterator<Item = R::Vec3>,
    last: R,
    behind: R::Vec3,
) -> R::Vec3 {
    weights.iter().zip(colors).fold(behind * last, |sum, (w, c)| sum + c * *w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    #[test]
    fn a_sharp_surface_hides_what_is_behind_it() {
        // Two surfaces: f falls through 0, rises, and falls through 0 again.
        let f = [0.5, 0.1, -0.3, 0.2, -0.4];
        let mut found = [0.0; 4];
        let last = weights(200.0, &f, 0.0, &mut found);
        assert_relative_eq!(found[..], [0.0, 1.0, 0.0, 0.0], epsilon = 1e-6);
        assert!(last < 1e-6);
    }

    proptest! {
        #[test]
        fn weights_and_the_last_transmittance_sum_to_one(
            f in prop::collection::vec(-1.0f64..1.0, 2..20), sharpness in 0.1f64..500.0,
        ) {
            let mut found = vec![0.0; f.len() - 1];
            let last = weights(sharpness, &f, 1e-3, &mut found);
            prop_assert!((found.iter().sum::<f64>() + last - 1.0).abs() < 1e-12);
            prop_assert!(found.iter().all(|w| *w >= 0.0));
        }

        #[test]
        fn the_reverse_mode_matches_differences(
            f in prop::collection::vec(-1.0f64..1.0, 2..12),
            colors in prop::collection::vec(-1.0f64..1.0, 12),
            sharpness in 0.5f64..20.0,
        ) {
            let n = f.len() - 1;
            let total = |f: &[f64]| {
                let mut own = vec![0.0; n];
                let last = weights(sharpness, f, 0.0, &mut own);
                own.iter().zip(&colors).map(|(w, c)| w * c).sum::<f64>() + 0.3 * last
            };
            let (mut own, mut bars) = (vec![0.0; n], vec![0.0; n + 1]);
            let last = weights(sharpness, &f, 0.0, &mut own);
            value_vjp(sharpness, &f, &own, (last, 0.3), &colors[..n], &mut bars);
            let h = 1e-6;
            for (i, bar) in bars.iter().enumerate() {
                let moved = |h: f64| {
                    let mut moved = f.clone();
                    moved[i] += h;
                    total(&moved)
                };
                let difference = (moved(h) - moved(-h)) / (2.0 * h);
                prop_assert!((bar - difference).abs() < 1e-6 * (1.0 + difference.abs()));
            }
        }
    }
}
