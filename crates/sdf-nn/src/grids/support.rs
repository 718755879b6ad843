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
    /// A bit for each node that is free, and a word without nodes.
    bits: Vec<u64>,
    /// The number of free nodes before each word.
    before: Vec<u32>,
    /// The free nodes, x slowest.
    nodes: Vec<u32>,
    /// Whether a point can have a free node, if its first node is in this brick.
    reaches: Vec<bool>,
}

/// The free ones among consecutive nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    /// A bit for each node that is free.
    pub(crate) is_free: u32,
    /// The number of the first of them among all free nodes.
    pub(crate) slot: usize,
}

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
        let across = side.div_ceil(BRICK);
        let mut bits = vec![0; side.pow(3).div_ceil(64) + 1];
        let mut has_free = vec![false; across.pow(3)];
        for node in &nodes {
            let node = *node as usize;
            bits[node / 64] |= 1u64 << (node % 64);
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
        let sums = bits.iter().scan(0, |next, word| {
            let before = *next;
            *next += word.count_ones();
            Some(before)
        });
        let before = sums.collect();
        Support { side, sparse: Some(Sparse { bits, before, nodes, reaches }) }
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

    /// Whether a node is free.
    pub(crate) fn is_free(&self, node: usize) -> bool {
        self.run::<1>(node).is_free == 1
    }

    /// The free ones among `T` nodes from `first` on.
    #[inline(always)]
    pub(crate) fn run<const T: usize>(&self, first: usize) -> Run {
        let all = (1 << T) - 1;
        let Some(Sparse { bits, before, .. }) = &self.sparse else {
            return Run { is_free: all, slot: first };
        };
        let (word, shift) = (first / 64, first % 64);
        let [low, high] = [bits[word], bits[word + 1]];
        let is_free = (low >> shift | high << 1 << (63 - shift)) as u32 & all;
        let below = low & ((1 << shift) - 1);
        Run { is_free, slot: (before[word] + below.count_ones()) as usize }
    }

    /// The free nodes in a range as spans of consecutive ones, and the number of the first of them
    /// among the free ones.
    pub(crate) fn spans_between(
        &self,
        range: Range<usize>,
    ) -> (usize, impl Iterator<Item = Range<usize>> + '_) {
        let (first, nodes, all) = match &self.sparse {
            None => (range.start, &[][..], Some(range)),
            Some(Sparse { nodes, .. }) => {
                let slot = |node: usize| nodes.partition_point(|n| (*n as usize) < node);
                let slots = slot(range.start)..slot(range.end);
                (slots.start, &nodes[slots], None)
            }
        };
        let span = |own: &[u32]| own[0] as usize..own[0] as usize + own.len();
        (first, all.into_iter().chain(nodes.chunk_by(|a, b| *b == a + 1).map(span)))
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
