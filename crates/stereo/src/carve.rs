//! Carving: surfaces that the photographs contradict go back.
//!
//! Kutulakos and Seitz, "A Theory of Shape by Space Carving", International Journal of Computer
//! Vision 38, 2000: matter whose colour is not the same in all photographs that see it is no part
//! of the object. The rest is the largest shape that explains the photographs.

/// A surface goes back where its pixel's loss is above this multiple of the mean. From twice it on,
/// the push does not grow.
const ERROR: f32 = 4.0;

/// A surface also goes back where its pixel's loss is above [`ERROR`] times the mean of surfaces
/// and above this share of the mean of the background: it explains its pixel no better than a
/// background that photographs do not agree on. Before another noise picture in each photograph,
/// the Chamfer distance is 0.41 % of the bounding radius without this rule, 0.36 % with a share of
/// 1, and 0.35 % with 0.5 (docs/rooms.md).
const BACKGROUND: f32 = 0.5;

/// The loss of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelLoss {
    /// The photometric loss.
    pub loss: f32,
    /// The number of pixels that this one stands for.
    pub count: f32,
    /// The opacity of the surface in the pixel, 0 to 1.
    pub opacity: f32,
}

/// The mean loss, weighted by a function of the pixel; 0 without pixels.
fn mean(losses: &[Option<PixelLoss>], weight: impl Fn(&PixelLoss) -> f32) -> f32 {
    let (mut sum, mut all) = (0.0, 0.0);
    for pixel in losses.iter().flatten() {
        let weight = weight(pixel) * pixel.count;
        (sum, all) = (sum + pixel.loss * weight, all + weight);
    }
    if all > 0.0 { sum / all } else { 0.0 }
}

/// The pushes of the surfaces of pixels, 0 to 1. Pixels without a loss do not count.
///
/// A surface is pushed where its pixel's loss is above four times the mean of all pixels. It is also
/// pushed where the loss is above four times the mean of surfaces and above half the mean of the
/// background. From twice the least loss on, the push is 1.
///
/// A surface that closes the space between the legs of an animal has a large error in each
/// photograph, but no derivative opens it: behind it is the inside of the solid.
pub fn pushes(losses: &[Option<PixelLoss>]) -> Vec<f32> {
    let all = mean(losses, |_| 1.0);
    let surface = mean(losses, |pixel| pixel.opacity);
    let background = mean(losses, |pixel| 1.0 - pixel.opacity);
    let least = (ERROR * all).min((ERROR * surface).max(BACKGROUND * background));
    let push = |loss: f32| if loss > least { (loss / least - 1.0).min(1.0) } else { 0.0 };
    losses.iter().map(|pixel| pixel.map_or(0.0, |pixel| push(pixel.loss))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(losses: &[f32], counts: &[f32], opacity: f32) -> Vec<f32> {
        let pixels = losses.iter().zip(counts);
        let pixels = pixels.map(|(loss, count)| PixelLoss { loss: *loss, count: *count, opacity });
        pushes(&pixels.map(Some).collect::<Vec<_>>())
    }

    #[test]
    fn pixels_with_a_large_loss_are_pushed() {
        // Nine pixels, of which one stands for three.
        let losses = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5, 1.0];
        let counts = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 1.0, 1.0];
        let mean = (9.0 * 0.1 + 1.5) / 11.0;
        let found = of(&losses, &counts, 1.0);
        assert!(found[..8].iter().all(|push| *push == 0.0), "{found:?}");
        assert!((found[8] - (1.0 / (4.0 * mean) - 1.0)).abs() < 1e-5, "{found:?}");
        // A pixel without a loss does not change the mean.
        let pixel = |(loss, count): (&f32, &f32)| {
            Some(PixelLoss { loss: *loss, count: *count, opacity: 1.0 })
        };
        let mut with_another: Vec<_> = losses.iter().zip(&counts).map(pixel).collect();
        with_another.push(None);
        assert_eq!(pushes(&with_another)[..9], found);
        let mut one = [0.01; 9];
        one[8] = 2.0;
        assert_eq!(of(&one, &[1.0; 9], 1.0)[8], 1.0);
        assert_eq!(of(&[0.0; 3], &[1.0; 3], 0.5), [0.0; 3]);
        assert!(pushes(&[]).is_empty());
    }

    #[test]
    fn a_surface_as_wrong_as_the_background_is_pushed() {
        // Ten pixels of a surface, of which one shows a background that nothing explains.
        let of = |background: f32, wrong: f32| {
            let pixel = |loss, opacity| Some(PixelLoss { loss, count: 1.0, opacity });
            let mut pixels = vec![pixel(0.01, 1.0); 9];
            pixels.push(pixel(wrong, 1.0));
            pixels.extend([pixel(background, 0.0); 10]);
            pushes(&pixels)[9]
        };
        assert_eq!(of(1.0, 0.45), 0.0);
        assert!((of(1.0, 0.6) - 0.2).abs() < 1e-5);
        // Four times the mean of all pixels, where the background is explained: 0.05 here.
        assert_eq!(of(0.01, 0.039), 0.0);
        let least = 4.0 * (19.0 * 0.01 + 0.06) / 20.0;
        assert!((of(0.01, 0.06) - (0.06 / least - 1.0)).abs() < 1e-5);
    }
}
