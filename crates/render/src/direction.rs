//! Directions of a data set: axes, and their names.

use glam::DVec3;

/// An upward direction this close to an axis is taken to be the axis, in degrees: cameras that look
/// down from one side only tilt their mean.
const SNAP_DEGREES: f64 = 20.0;

/// A direction as text: the name of an axis, or numbers.
pub fn named(up: DVec3) -> String {
    let axes = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)];
    for (name, axis) in axes {
        for (sign, axis) in [("", axis), ("-", -axis)] {
            if up == axis {
                return format!("{sign}{name}");
            }
        }
    }
    format!("({:.2}, {:.2}, {:.2})", up.x, up.y, up.z)
}

/// The axis within 20 degrees of a unit vector, or else the vector.
pub fn snapped(up: DVec3) -> DVec3 {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let cosine = SNAP_DEGREES.to_radians().cos();
    axes.into_iter().find(|axis| axis.dot(up) >= cosine).unwrap_or(up)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_near_an_axis_is_the_axis() {
        let tilted = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            DVec3::new(s, -c, 0.0)
        };
        assert_eq!(snapped(tilted(19.0)), DVec3::NEG_Y);
        assert_eq!(snapped(tilted(21.0)), tilted(21.0));
        assert_eq!(named(DVec3::NEG_Y), "-y");
        assert_eq!(named(tilted(30.0)), "(0.50, -0.87, 0.00)");
    }
}
