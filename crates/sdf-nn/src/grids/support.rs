//! The nodes of a level of splines whose coefficients are free; all others are zero.

use std::ops::Range;

/// Nodes along a side of a brick, of which it is known whether a node is free.
const BRICK: usize = 4;

/// The free nodes of a level.
#[derive(Clone, Debug)]
pub(crate) struct Support {
    side: usize,
    /// The free nodes, if they are not all.
    sparse: Option<Sparse>,
}

/// Some nodes of a level.
#[derive(Clone, Debug)]
struct Sparse {
    /// The number among the free nodes of each node, or [`NONE`].
    slots: Vec<u32>,
    /// The free nodes, x slowest.
    nodes: Vec<u32>,
    /// Whether a point can have a free node, if its first node is in this brick.
    reaches: Vec<bool>,
}

/// The slot of a node that is not free.
pub(crate) const NONE: u32 = u32::MAX;

impl Support {
    /// All nodes of a level with `side` nodes along a side.
    pub(crate) fn all(side: usize) -> Self {
        Support { side, sparse: None }
    }

    /// The free nodes, by a flag for each node, x slowest.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub(crate) fn of_nodes(side: usize, is_free: &[bool]) -> Self {
        assert_eq!(is_free.len(), side.pow(3), "nodes of a level of splines");
        if is_free.iter().all(|free| *free) {
            return Self::all(side);
        }
        let nodes: Vec<u32> = (0..).zip(is_free).filter(|(_, free)| **free).map(|n| n.0).collect();
        let (mut slots, across) = (vec![NONE; side.pow(3)], side.div_ceil(BRICK));
        let mut has_free = vec![false; across.pow(3)];
        for (slot, node) in nodes.iter().enumerate() {
            let node = *node as usize;
            slots[node] = slot as u32;
            let [x, y, z] =
                [node / side / side, node / side % side, node % side].map(|i| i / BRICK);
            has_free[(x * across + y) * across + z] = true;
        }
        // The nodes of a point are at most three apart, so they are in a brick and the next ones.
        let reaches = |b: usize| {
            let first = [b / across / across, b / across % across, b % across];
            (0..8).any(|corner| {
                let [x, y, z] = std::array::from_fn(|a| first[a] + (corner >> a & 1));
                x.max(y).max(z) < across && has_free[(x * across + y) * across + z]
            })
        };
        let reaches = (0..across.pow(3)).map(reaches).collect();
        Support { side, sparse: Some(Sparse { slots, nodes, reaches }) }
    }

    /// Whether each node is free, x slowest.
    pub(crate) fn flags(&self) -> Vec<bool> {
        let mut flags = vec![false; self.side.pow(3)];
        self.nodes().for_each(|node| flags[node] = true);
        flags
    }

    /// The number of free nodes.
    pub(crate) fn count(&self) -> usize {
        self.sparse.as_ref().map_or(self.side.pow(3), |sparse| sparse.nodes.len())
    }

    /// Whether a point may have a free node, from the first of its nodes.
    #[inline(always)]
    pub(crate) fn reaches(&self, first: [usize; 3]) -> bool {
        let Some(sparse) = &self.sparse else { return true };
        let across = self.side.div_ceil(BRICK);
        let [x, y, z] = [first[0] / BRICK, first[1] / BRICK, first[2] / BRICK];
        sparse.reaches[(x * across + y) * across + z]
    }

    /// The number of a node among the free ones.
    pub(crate) fn slot(&self, node: usize) -> Option<usize> {
        match &self.sparse {
            None => Some(node),
            Some(sparse) if sparse.slots[node] == NONE => None,
            Some(sparse) => Some(sparse.slots[node] as usize),
        }
    }

    /// The numbers of consecutive nodes among the free ones, or [`NONE`].
    #[inline(always)]
    pub(crate) fn slots<const T: usize>(&self, first: usize) -> [u32; T] {
        let mut slots = [NONE; T];
        match &self.sparse {
            None => (0..T).for_each(|z| slots[z] = (first + z) as u32),
            Some(sparse) => slots.copy_from_slice(&sparse.slots[first..first + T]),
        }
        slots
    }

    /// The free nodes in a range, and the number of the first of them among the free ones.
    pub(crate) fn nodes_between(
        &self,
        range: Range<usize>,
    ) -> (usize, impl Iterator<Item = usize> + '_) {
        let slots = match &self.sparse {
            None => range,
            Some(Sparse { nodes, .. }) => {
                let slot = |node: usize| nodes.partition_point(|n| (*n as usize) < node);
                slot(range.start)..slot(range.end)
            }
        };
        (slots.start, slots.map(|slot| self.node(slot)))
    }

    /// The free nodes, in the order of their numbers.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.count()).map(|slot| self.node(slot))
    }

    /// The free node with this number.
    fn node(&self, slot: usize) -> usize {
        self.sparse.as_ref().map_or(slot, |sparse| sparse.nodes[slot] as usize)
    }
}
