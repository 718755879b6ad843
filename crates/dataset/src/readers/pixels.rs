//! Sizes of images in camera files.

/// The width or the height of an image, in pixels, if the number is whole and from 1 to 65535.
pub(crate) fn whole_pixels(number: f64) -> Option<u32> {
    #[expect(clippy::cast_possible_truncation, reason = "the number is compared with the result")]
    let whole = number as u16;
    (whole > 0 && f64::from(whole) == number).then_some(whole.into())
}
