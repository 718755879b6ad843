//! Squares of pixels around a pixel.

use std::ops::RangeInclusive;

/// The coordinates along a side of an image that are up to `margin` from `v`.
pub(crate) fn near(v: u32, margin: u32, side: u32) -> RangeInclusive<u32> {
    v.saturating_sub(margin)..=(v + margin).min(side - 1)
}

/// For each pixel of an image, row-major, whether it and all pixels in the square with this margin
/// around it are flagged.
pub(crate) fn with_margin(flags: &[bool], [width, height]: [u32; 2], margin: u32) -> Vec<bool> {
    let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let near = |v: u32, side: u32| near(v, margin, side);
    // A square is a row of columns: test the columns first, then the rows.
    let columns: Vec<bool> =
        all().map(|(x, y)| near(y, height).all(|y| flags[(y * width + x) as usize])).collect();
    all().map(|(x, y)| near(x, width).all(|x| columns[(y * width + x) as usize])).collect()
}
