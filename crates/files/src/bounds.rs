//! Bounding spheres as text.

/// Parses a sphere from the text x,y,z,radius.
///
/// # Errors
/// If the text does not have four finite numbers, or the radius is not above 0. The error describes
/// the expected text.
pub fn parse_bounds(text: &str) -> Result<[f64; 4], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    match numbers.ok().and_then(|n| <[f64; 4]>::try_from(n).ok()) {
        Some(bounds) if is_sphere(bounds) => Ok(bounds),
        _ => Err(format!("expected x,y,z,radius with {SPHERE}")),
    }
}

/// The bounding spheres that single precision can hold, with the squares of their lengths.
pub const SPHERE: &str = "coordinates up to 1e12 and a radius from 1e-12 to 1e12";

/// Whether x, y, z and a radius are a [`SPHERE`].
pub fn is_sphere([x, y, z, radius]: [f64; 4]) -> bool {
    [x, y, z].iter().all(|c| c.abs() <= 1e12) && (1e-12..=1e12).contains(&radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_need_four_numbers() {
        assert_eq!(parse_bounds("1,2,-3,0.5"), Ok([1.0, 2.0, -3.0, 0.5]));
        for text in ["", "1,2,3", "1,2,3,0", "1,2,3,nan", "1,2,3,1e300", "inf,2,3,1", "a,b,c,d"] {
            assert!(parse_bounds(text).is_err(), "{text}");
        }
    }
}
