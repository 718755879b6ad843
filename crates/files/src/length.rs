//! Lengths for messages.

/// The scale below which four decimals of a length are too few.
const SMALL: f64 = 0.01;

/// A length or a coordinate of a scene whose size is `scale`: with four decimals, or with four
/// digits and an exponent where the scene is too small for them.
///
/// ```
/// assert_eq!(files::length(1.25, 2.0), "1.2500");
/// assert_eq!(files::length(3.2e-6, 1e-5), "3.200e-6");
/// assert_eq!(files::length(0.0, 1e-5), "0.000e0");
/// ```
pub fn length(value: f64, scale: f64) -> String {
    if scale.abs() < SMALL { format!("{value:.3e}") } else { format!("{value:.4}") }
}

/// A point of a scene whose size is `scale`, as [`length`] writes its coordinates.
pub fn point(point: [f64; 3], scale: f64) -> String {
    format!("({})", point.map(|x| length(x, scale)).join(", "))
}
