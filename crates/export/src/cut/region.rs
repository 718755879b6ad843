//! Boxes and spheres that a mesh is cut to.

use std::str::FromStr;

use glam::DVec3;

/// A part of space, in the units of the data set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// A box along the axes, with its surface.
    Box {
        /// The corner of least coordinates.
        low: DVec3,
        /// The corner of largest coordinates.
        high: DVec3,
    },
    /// A ball, with its surface.
    Sphere {
        /// The centre.
        center: DVec3,
        /// The radius, above 0.
        radius: f64,
    },
}

/// The largest coordinate and radius of a region: squares of distances stay finite.
const MAX_COORDINATE: f64 = 1e12;

/// The forms of a region as text.
const FORMS: &str = "box:x0,y0,z0,x1,y1,z1 with each first coordinate below the second, or \
    sphere:x,y,z,radius with a radius above 0; finite numbers up to 1e12";

impl Region {
    /// Whether the point `x` is in the region.
    pub fn contains(&self, x: DVec3) -> bool {
        match self {
            Region::Box { low, high } => x.cmpge(*low).all() && x.cmple(*high).all(),
            Region::Sphere { center, radius } => x.distance(*center) <= *radius,
        }
    }

    /// The region of these numbers, if it has an interior.
    fn new(kind: &str, numbers: &[f64]) -> Option<Self> {
        if numbers.iter().any(|n| n.is_nan() || n.abs() > MAX_COORDINATE) {
            return None;
        }
        match (kind, numbers) {
            ("box", [x0, y0, z0, x1, y1, z1]) => {
                let (low, high) = (DVec3::new(*x0, *y0, *z0), DVec3::new(*x1, *y1, *z1));
                low.cmplt(high).all().then_some(Region::Box { low, high })
            }
            ("sphere", [x, y, z, radius]) if *radius > 0.0 => {
                Some(Region::Sphere { center: DVec3::new(*x, *y, *z), radius: *radius })
            }
            _ => None,
        }
    }
}

impl FromStr for Region {
    type Err = String;

    /// Reads `box:x0,y0,z0,x1,y1,z1` or `sphere:x,y,z,radius`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, list) = text.split_once(':').unwrap_or_default();
        let numbers: Result<Vec<f64>, _> = list.split(',').map(|n| n.trim().parse()).collect();
        let region = numbers.ok().and_then(|numbers| Region::new(kind, &numbers));
        region.ok_or_else(|| format!("expected {FORMS}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_contains_its_points_and_no_others() {
        let unit: Region = "box:0,-1,2, 1,1,2.5".parse().unwrap();
        assert!(unit.contains(DVec3::new(0.0, 1.0, 2.2)));
        for outside in [[-0.1, 0.0, 2.2], [0.5, 1.1, 2.2], [0.5, 0.0, 2.6], [f64::NAN, 0.0, 2.2]] {
            assert!(!unit.contains(DVec3::from(outside)), "{outside:?}");
        }
        let ball: Region = "sphere:1,0,0,0.5".parse().unwrap();
        assert!(ball.contains(DVec3::new(1.3, 0.3, 0.2)));
        assert!(!ball.contains(DVec3::new(1.4, 0.3, 0.2)));
    }

    #[test]
    fn wrong_regions_are_refused() {
        for text in [
            "",
            "box",
            "box:1,2,3",
            "box:0,0,0,1,1,0",
            "box:0,0,0,1,-1,1",
            "box:0,0,0,1,1,nan",
            "box:0,0,0,1,1,1,1",
            "sphere:0,0,0,-1",
            "sphere:0,0,0,0",
            "sphere:0,0,0,inf",
            "sphere:0,0,x,1",
            "ball:0,0,0,1",
        ] {
            let error = text.parse::<Region>().unwrap_err();
            assert!(error.starts_with("expected box:"), "{text}: {error}");
        }
    }
}
