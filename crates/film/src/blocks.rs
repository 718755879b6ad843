//! Means over blocks of pixels.

/// Row `y` of an image at 1/`n` of its size, rounded up, with `C` channels.
///
/// `row` writes a row of the whole image, whose width and height are `size`. A pixel of the result
/// is the mean of the n × n pixels that it covers; at the right and the lower border, of those that
/// exist. The sums add row by row, from the left, so that all callers get the same bits.
///
/// # Panics
/// If `n` is 0.
pub fn block_row<const C: usize>(
    size: [u32; 2],
    n: u32,
    y: u32,
    row: impl Fn(u32, &mut [[f32; C]]),
) -> Vec<[f32; C]> {
    let [width, height] = size;
    let mut whole = vec![[0.0; C]; width as usize];
    if n == 1 {
        row(y, &mut whole);
        return whole;
    }
    let mut out = vec![[0.0; C]; width.div_ceil(n) as usize];
    let rows = n * y..(n * y).saturating_add(n).min(height);
    for v in rows.clone() {
        row(v, &mut whole);
        for (sum, block) in out.iter_mut().zip(whole.chunks(n as usize)) {
            let mut own = *sum;
            block.iter().for_each(|pixel| (0..C).for_each(|c| own[c] += pixel[c]));
            *sum = own;
        }
    }
    for (sum, block) in out.iter_mut().zip(whole.chunks(n as usize)) {
        // Up to 2^24 pixels are counted exactly.
        let count = block.len() as f32 * rows.len() as f32;
        *sum = sum.map(|sum| sum / count);
    }
    out
}
