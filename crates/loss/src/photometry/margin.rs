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
    // The square contains the pixel itself.
    let is_in = |flags: &[bool], x: u32, y: u32| flags[(y * width + x) as usize];
    let column = |(x, y)| is_in(flags, x, y) && near(y, height).all(|y| is_in(flags, x, y));
    let columns: Vec<bool> = all().map(column).collect();
    let square = |(x, y)| is_in(&columns, x, y) && near(x, width).all(|x| is_in(&columns, x, y));
    all().map(square).collect()
}
