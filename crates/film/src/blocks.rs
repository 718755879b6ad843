//! Means over blocks of pixels.

/// Row `y` of an image at 1/`n` of its size, rounded up, with `C` channels.
///
/// `at` gives the pixel in a column and a row of the whole image, whose width and height are
/// `size`. A pixel of the row is the mean of the n × n pixels that it covers; at the right and the
/// lower border, of those that exist. The sums add row by row, from the left, so that all callers
/// get the same bits.
///
/// # Panics
/// If `n` is 0.
pub fn block_row<const C: usize>(
    size: [u32; 2],
    n: u32,
    y: u32,
    at: impl Fn(u32, u32) -> [f32; C],
) -> Vec<[f32; C]> {
    let [width, height] = size;
    if n == 1 {
        return (0..width).map(|x| at(x, y)).collect();
    }
    let mut row = vec![[0.0; C]; width.div_ceil(n) as usize];
    let rows = n * y..(n * y).saturating_add(n).min(height);
    for v in rows.clone() {
        for (sum, x) in row.iter_mut().zip(0..) {
            for u in columns(width, n, x) {
                let pixel = at(u, v);
                for (sum, value) in sum.iter_mut().zip(pixel) {
                    *sum += value;
                }
            }
        }
    }
    for (sum, x) in row.iter_mut().zip(0..) {
        // At most 2^24 pixels are counted exactly.
        let count = columns(width, n, x).len() as f32 * rows.len() as f32;
        *sum = sum.map(|sum| sum / count);
    }
    row
}

/// The columns that pixel `x` of a row covers.
fn columns(width: u32, n: u32, x: u32) -> std::ops::Range<u32> {
    n * x..(n * x).saturating_add(n).min(width)
}
