//! The sRGB transfer function (IEC 61966-2-1:1999) and its inverse.

/// The display value of a linear radiance, by the sRGB transfer function (IEC 61966-2-1:1999).
///
/// Maps 0 to 0 and 1 to 1. Nothing is clipped: values above 1 follow the same power law.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear radiance of a display value: the inverse of [`srgb_encode`].
pub fn srgb_decode(display: f32) -> f32 {
    if display <= 0.040_45 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn encoding_inverts_decoding() {
        for i in 0..=255 {
            let display = i as f32 / 255.0;
            assert_relative_eq!(srgb_encode(srgb_decode(display)), display, epsilon = 1e-6);
        }
    }
}
