//! The nodes of a level of splines near a surface.

use rayon::prelude::*;

use crate::grids::Splines;

/// Nodes along a side of a block.
const BLOCK: usize = 4;

/// Blocks that a thread takes at a time.
const BLOCKS: usize = 512;

/// The largest slope of a field between the nodes of a block.
const STEEP: f64 = 2.0;

impl Splines {
    /// Whether each node of a level, x slowest, has |f| ≤ `near`. `values` gives the values of the
    /// field f at points of the cube, on any thread.
    ///
    /// In most blocks of nodes, f at the middle tells that none has: f is taken to have a slope of
    /// 2 at most.
    ///
    /// # Panics
    /// If `values` does not give a value for each point.
    pub fn nodes_near(
        &self,
        level: usize,
        near: f64,
        values: impl Fn(&[[f64; 3]]) -> Vec<f64> + Sync,
    ) -> Vec<bool> {
        let side = self.size().levels[level];
        let index = |[x, y, z]: [usize; 3]| (x * side + y) * side + z;
        let values_of = |nodes: &[usize]| {
            let points: Vec<_> = nodes.iter().map(|node| self.node(level, *node)).collect();
            let f = values(&points);
            assert_eq!(f.len(), points.len(), "values of a field at nodes");
            f
        };
        let across = side.div_ceil(BLOCK);
        let blocks: Vec<[usize; 3]> = (0..across.pow(3))
            .map(|b| [b / across / across, b / across % across, b % across].map(|i| i * BLOCK))
            .collect();
        let middle = |first: &[usize; 3]| index(first.map(|i| (i + BLOCK / 2).min(side - 1)));
        // From the middle of a block to its first node, the farthest one.
        let interval = self.node(level, index([1; 3]))[0] - self.node(level, 0)[0];
        let reach = 3f64.sqrt() * (BLOCK / 2) as f64 * interval;
        let nodes_of = |first: &[[usize; 3]]| -> Vec<usize> {
            let f = values_of(&first.iter().map(middle).collect::<Vec<_>>());
            let met = first.iter().zip(f).filter(|(_, f)| f.abs() <= near + STEEP * reach);
            let along = |first: usize| first..(first + BLOCK).min(side);
            let nodes = met.flat_map(|([x, y, z], _)| {
                along(*x).flat_map(move |x| {
                    along(*y).flat_map(move |y| along(*z).map(move |z| index([x, y, z])))
                })
            });
            let nodes: Vec<usize> = nodes.collect();
            let f = values_of(&nodes);
            nodes.into_iter().zip(f).filter(|(_, f)| f.abs() <= near).map(|(n, _)| n).collect()
        };
        let mut is_near = vec![false; side.pow(3)];
        let found: Vec<Vec<usize>> = blocks.par_chunks(BLOCKS).map(nodes_of).collect();
        found.into_iter().flatten().for_each(|node| is_near[node] = true);
        is_near
    }
}

#[cfg(test)]
mod tests {
    use crate::grids::{Degree, SplineSize, Splines};

    #[test]
    fn the_nodes_near_a_surface_are_those_of_a_test_of_all() {
        // An ellipsoid, with slopes of up to 1.4.
        let f = |[x, y, z]: &[f64; 3]| (x * x + 2.0 * y * y + z * z).sqrt() - 0.6;
        let size = SplineSize { levels: vec![6, 41], features: 1, degree: Degree::Quadratic };
        let splines = Splines::new(size);
        for level in [0, 1] {
            let near = 1.5 * splines.reach(level);
            let all = 0..splines.size().levels[level].pow(3);
            let expected: Vec<bool> =
                all.map(|node| f(&splines.node(level, node)).abs() <= near).collect();
            let found = splines.nodes_near(level, near, |points| points.iter().map(f).collect());
            assert_eq!(found, expected);
            assert!(found.contains(&true) && found.contains(&false));
        }
    }
}
