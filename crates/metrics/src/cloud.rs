//! Distances between a surface and a cloud of points: the protocol of the DTU data set.

use std::collections::HashSet;

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use mesh::Mesh;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::sample_surface;

/// The closeness of a reconstruction to a reference cloud, in world units.
///
/// The means and medians are of the distances up to the cap; `None` if all are above it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloudComparison {
    /// The distances from points of the reconstruction to the nearest points of the reference.
    pub accuracy: Distances,
    /// The distances from the points of the reference to the nearest points of the reconstruction.
    pub completeness: Distances,
}

/// The distances from one cloud to another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distances {
    /// The mean of the distances up to the cap.
    pub mean: Option<f64>,
    /// The median of the distances up to the cap.
    pub median: Option<f64>,
    /// The part of the points that are further than the cap, 0 to 1.
    pub beyond: f64,
    /// The number of points.
    pub points: usize,
}

impl CloudComparison {
    /// The mean of both directions, which DTU calls overall.
    pub fn overall(&self) -> Option<f64> {
        Some(0.5 * (self.accuracy.mean? + self.completeness.mean?))
    }
}

/// The number of random points for each square of the spacing, before thinning. A disc of the
/// radius of the spacing, which thinning fills, is empty with the probability e^(−2π) = 0.2 %.
const DRAWN: f64 = 2.0;

/// The number of points that [`compare_to_cloud`] draws on a mesh for a spacing in world units.
pub fn points_drawn(mesh: &Mesh, spacing: f64) -> f64 {
    (DRAWN * mesh.area() / (spacing * spacing)).ceil()
}

/// Compares a mesh with a cloud of points in the coordinates of the mesh's vertices, as DTU does.
///
/// Points are drawn on the mesh and thinned: no two are nearer than `spacing`. So each part of the
/// surface counts by its area. Distances are from points to points, and those above `cap` are left
/// out. Both lengths are in world units, above 0. DTU's are 0.2 mm and 20 mm (R. Jensen, A. Dahl,
/// G. Vogiatzis, E. Tola, H. Aanæs, "Large Scale Multi-view Stereopsis Evaluation", CVPR 2014;
/// H. Aanæs, R. Jensen, G. Vogiatzis, E. Tola, A. Dahl, "Large-Scale Data for Multiple-View
/// Stereopsis", IJCV 2016).
///
/// Without points on one side, there are no distances. The result is a pure function of the
/// arguments.
pub fn compare_to_cloud(
    mesh: &Mesh,
    reference: &[DVec3],
    spacing: f64,
    cap: f64,
) -> CloudComparison {
    let drawn = sample_surface(mesh, points_drawn(mesh, spacing) as usize, 1);
    let drawn: Vec<DVec3> = drawn.iter().map(|p| p.position).collect();
    let points = thinned(&drawn, spacing);
    CloudComparison {
        accuracy: Distances::new(&points, reference, cap),
        completeness: Distances::new(reference, &points, cap),
    }
}

impl Distances {
    fn new(from: &[DVec3], to: &[DVec3], cap: f64) -> Self {
        if from.is_empty() || to.is_empty() {
            return Distances { points: from.len(), ..Distances::default() };
        }
        let cloud = Cloud::new(to);
        Distances::of(from.par_iter().map(|x| cloud.distance(*x)).collect(), cap)
    }

    /// The distances of some points, at least one.
    pub(crate) fn of(all: Vec<f64>, cap: f64) -> Self {
        let points = all.len();
        let mut near: Vec<f64> = all.into_iter().filter(|d| *d <= cap).collect();
        let count = near.len();
        let mean = (count > 0).then(|| near.iter().sum::<f64>() / count as f64);
        near.sort_by(f64::total_cmp);
        let median = (count > 0).then(|| 0.5 * (near[(count - 1) / 2] + near[count / 2]));
        let beyond = 1.0 - count as f64 / points as f64;
        Distances { mean, median, beyond, points }
    }
}

/// Points, one of each set of equal ones, in a k-d tree.
struct Cloud {
    points: Vec<[f64; 3]>,
    /// `None` if the tree cannot be built. Then a query measures every point.
    tree: Option<ImmutableKdTree<f64, 3>>,
}

impl Cloud {
    fn new(points: &[DVec3]) -> Self {
        let mut known = HashSet::new();
        // Adding 0 makes −0 equal to 0.
        let bits = |p: &DVec3| (*p + DVec3::ZERO).to_array().map(f64::to_bits);
        let points = points.iter().filter(|p| known.insert(bits(p)));
        let points: Vec<[f64; 3]> = points.map(|p| p.to_array()).collect();
        // A query of an empty tree panics.
        let tree = Some(&points).filter(|p| !p.is_empty());
        let tree = tree.and_then(|p| ImmutableKdTree::new_from_slice(p).ok());
        Cloud { points, tree }
    }

    /// The distance from `x` to the nearest point.
    fn distance(&self, x: DVec3) -> f64 {
        let measure = |p: &[f64; 3]| DVec3::from(*p).distance(x);
        match self.tree.as_ref().filter(|_| x.is_finite()) {
            Some(tree) => {
                let query = x.to_array();
                let nearest = tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute();
                measure(&self.points[nearest.item as usize])
            }
            None => self.points.iter().map(measure).fold(f64::INFINITY, f64::min),
        }
    }
}

/// The points without those nearer than `spacing` to one that is kept, in their order.
///
/// Points are kept in cubes of the side `spacing`, so a near point is in a cube or beside it.
fn thinned(points: &[DVec3], spacing: f64) -> Vec<DVec3> {
    const NONE: usize = usize::MAX;
    let mut kept: Vec<DVec3> = Vec::new();
    // The last kept point of each cube, and for each kept point the one before it in its cube.
    let (mut last, mut before) = (FxHashMap::<[i64; 3], usize>::default(), Vec::new());
    for x in points {
        let cube = (*x / spacing).floor().to_array().map(|c| c as i64);
        let is_free = NEIGHBOURS.iter().all(|step| {
            let place = [0, 1, 2].map(|k| cube[k].saturating_add(step[k]));
            let mut i = last.get(&place).copied().unwrap_or(NONE);
            while i != NONE && kept[i].distance(*x) >= spacing {
                i = before[i];
            }
            i == NONE
        });
        if is_free {
            before.push(last.insert(cube, kept.len()).unwrap_or(NONE));
            kept.push(*x);
        }
    }
    kept
}

/// The steps from a cube to itself and to the cubes around it.
const NEIGHBOURS: [[i64; 3]; 27] = {
    let mut steps = [[0; 3]; 27];
    let mut i = 0;
    while i < 27 {
        let n = i as i64;
        steps[i] = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
        i += 1;
    }
    steps
};

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use field::{Shape, Sphere};
    use mesh::extract;
    use random::{Name, Stream};

    const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.2 };

    fn ball(radius: f64) -> Mesh {
        extract(&Shape::<f64>::sphere([0.0; 3], radius), &BOUNDS, 64, &|_| {})
    }

    /// Random points of a sphere, uniform by area, with z from `low`·radius to the radius.
    fn cloud(radius: f64, low: f64, count: u64) -> Vec<DVec3> {
        let stream = Stream::of_seed(5).named(Name::other("points of a cloud"));
        let point = |i: u64| {
            let [a, b] = [0, 1].map(|k| stream.at(i).at(k).unit());
            let (z, angle) = (low + (1.0 - low) * a, std::f64::consts::TAU * b);
            let across = (1.0 - z * z).sqrt();
            radius * DVec3::new(across * angle.cos(), across * angle.sin(), z)
        };
        (0..count).map(point).collect()
    }

    /// The distance between concentric spheres whose points are close together is the difference of
    /// their radii.
    #[test]
    fn concentric_spheres_are_as_far_apart_as_their_radii() {
        let reference = cloud(0.8, -1.0, 200_000);
        let c = compare_to_cloud(&ball(0.7), &reference, 0.01, 0.5);
        for d in [c.accuracy, c.completeness] {
            assert_relative_eq!(d.mean.unwrap(), 0.1, epsilon = 5e-4);
            assert_relative_eq!(d.median.unwrap(), 0.1, epsilon = 5e-4);
            assert_eq!(d.beyond, 0.0);
        }
        assert_relative_eq!(c.overall().unwrap(), 0.1, epsilon = 5e-4);
        assert_eq!(c.completeness.points, 200_000);
        // With a cap below the distance, nothing is left.
        let c = compare_to_cloud(&ball(0.7), &reference, 0.05, 0.09);
        assert_eq!((c.accuracy.mean, c.accuracy.median, c.accuracy.beyond), (None, None, 1.0));
        assert_eq!(c.overall(), None);
    }

    /// The reference is a hemisphere. Points of the other hemisphere are at the distance
    /// 2 r sin(φ/2) from its edge, where φ is their angle below the edge; their share of the whole
    /// sphere with an angle below φ is sin(φ)/2.
    #[test]
    fn half_a_sphere_is_complete_and_half_accurate_and_the_cap_cuts_the_rest() {
        let (radius, spacing): (f64, f64) = (0.7, 0.01);
        let reference = cloud(radius, 0.0, 100_000);
        let share = |cap: f64| (2.0 * (cap / (2.0 * radius)).asin()).sin() / 2.0;
        for cap in [0.1, 0.3] {
            let c = compare_to_cloud(&ball(radius), &reference, spacing, cap);
            assert_relative_eq!(c.accuracy.beyond, 0.5 - share(cap), epsilon = 0.01);
            // The integral of the distances of the lower half, by the middles of 1000 intervals.
            let below = (0..1000).map(|i| {
                let d = cap * (f64::from(i) + 0.5) / 1000.0;
                d * (share(d + 5e-4 * cap) - share(d - 5e-4 * cap))
            });
            let expected = below.sum::<f64>() / (0.5 + share(cap));
            // Points on the upper half are a part of the reference's spacing away.
            let mean = c.accuracy.mean.unwrap();
            assert!((0.0..0.003).contains(&(mean - expected)), "{mean} and {expected}");
            assert!(c.accuracy.median.unwrap() < 0.01, "{c:?}");
            assert!(c.completeness.mean.unwrap() < 0.7 * spacing, "{c:?}");
            assert_eq!(c.completeness.beyond, 0.0);
        }
    }

    #[test]
    fn thinned_points_are_apart_and_leave_no_gap() {
        let points = cloud(0.5, -1.0, 5000);
        let spacing = 0.05;
        let kept = thinned(&points, spacing);
        for (i, a) in kept.iter().enumerate() {
            assert!(kept[..i].iter().all(|b| a.distance(*b) >= spacing));
        }
        let near = |x: &DVec3| kept.iter().any(|k| k.distance(*x) < spacing);
        assert!(kept.len() < points.len() && points.iter().all(near));
        assert_eq!(thinned(&[DVec3::ONE; 3], 0.1), [DVec3::ONE]);
    }

    /// Planar grids and equal points are hard for k-d trees.
    #[test]
    fn grids_and_equal_points_can_be_searched() {
        let grid = |i: usize| DVec3::new((i % 200) as f64, (i / 200) as f64, 0.0);
        let mut reference: Vec<DVec3> = (0..40_000).map(grid).collect();
        reference.extend(vec![DVec3::ZERO; 3000]);
        let cloud = Cloud::new(&reference);
        assert!(cloud.tree.is_some() && cloud.points.len() == 40_000);
        assert_eq!(cloud.distance(DVec3::new(17.25, 40.0, 3.0)), (9.0f64 + 0.0625).sqrt());
        let empty = compare_to_cloud(&Mesh::default(), &reference, 0.1, 1.0);
        assert_eq!((empty.accuracy.points, empty.overall()), (0, None));
        assert_eq!(compare_to_cloud(&ball(0.5), &[], 0.1, 1.0).overall(), None);
    }
}
