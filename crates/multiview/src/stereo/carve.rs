//! Carving: the fit removes surface that the photographs contradict.
//!
//! Kutulakos and Seitz, "A Theory of Shape by Space Carving", International Journal of Computer
//! Vision 38, 2000: matter whose colour is not the same in all photographs that see it is no part
//! of the object. The rest is the largest shape that explains the photographs.

/// The fit removes surface behind pixels whose loss is above this multiple of the mean. Above twice
/// this loss, the push does not grow.
const ERROR: f32 = 4.0;

/// The pushes of the surfaces of pixels, 0 to 1, from the loss of each pixel and the number of
/// pixels that it stands for. Pixels without a loss do not count.
///
/// A surface that closes the space between the legs of an animal has a large error in each
/// photograph, but no derivative opens it: behind it is the inside of the solid.
pub fn pushes(losses: impl Iterator<Item = (Option<f32>, f32)> + Clone) -> Vec<f32> {
    let known = losses.clone().filter_map(|(loss, count)| Some((loss?, count)));
    let (sum, all) =
        known.fold((0.0, 0.0), |(sum, all), (loss, count)| (sum + loss * count, all + count));
    let least = ERROR * sum / f32::max(all, 1.0);
    let push = |loss: f32| if loss > least { (loss / least - 1.0).min(1.0) } else { 0.0 };
    losses.map(|(loss, _)| loss.map_or(0.0, push)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(losses: &[f32], counts: &[f32]) -> Vec<f32> {
        pushes(losses.iter().map(|loss| Some(*loss)).zip(counts.iter().copied()))
    }

    #[test]
    fn pixels_with_a_large_loss_are_pushed() {
        // Nine pixels, of which one stands for three: the mean is 0.2.
        let losses = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5, 1.0];
        let counts = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 1.0, 1.0];
        let mean = (9.0 * 0.1 + 1.5) / 11.0;
        let found = of(&losses, &counts);
        assert!(found[..8].iter().all(|push| *push == 0.0), "{found:?}");
        assert!((found[8] - (1.0 / (4.0 * mean) - 1.0)).abs() < 1e-5, "{found:?}");
        // A pixel without a loss does not change the mean.
        let with_another = losses.iter().zip(counts).map(|(l, c)| (Some(*l), c));
        assert_eq!(pushes(with_another.chain([(None, 9.0)]))[..9], found);
        let mut one = [0.01; 9];
        one[8] = 2.0;
        assert_eq!(of(&one, &[1.0; 9])[8], 1.0);
        assert_eq!(of(&[0.0; 3], &[1.0; 3]), [0.0; 3]);
    }
}
