//! The empty cells around the tissue, into which surfaces bulge.

use std::collections::{BTreeMap, BTreeSet};

use super::surface::grid::{GridEdge, GridNode, edges_at, is_outer, is_tissue, node_of};
use crate::model::lattice::{BRICK_SLOTS, Lattice};

/// The edges of the grid beside the tissue, and the tissue nodes that their ends move with.
#[derive(Clone, Debug)]
pub struct Margin {
    edges: Vec<(GridEdge, [u32; 2])>,
    /// Which of them hang on nodes of these two bricks.
    of_bricks: BTreeMap<[u32; 2], Vec<u32>>,
    reach: usize,
}

impl Margin {
    /// Of a lattice, as far as `reach` edges from its tissue.
    pub fn new(lattice: &Lattice, reach: usize) -> Self {
        let tissue = lattice.slots().map(|slot| (node_of(lattice, slot), slot));
        let mut nearest: BTreeMap<GridNode, u32> =
            tissue.filter(|&(node, _)| is_outer(lattice, node)).collect();
        let mut front: Vec<GridNode> = nearest.keys().copied().collect();
        for _ in 0..reach {
            let mut next = Vec::new();
            for node in front {
                let slot = nearest[&node];
                for (_, other) in edges_at(node).filter(|&(edge, _)| !is_tissue(lattice, edge)) {
                    nearest.entry(other).or_insert_with(|| {
                        next.push(other);
                        slot
                    });
                }
            }
            front = next;
        }
        let edges: BTreeSet<GridEdge> =
            nearest.keys().flat_map(|&node| edges_at(node)).map(|(edge, _)| edge).collect();
        let ends = |edge: GridEdge| {
            let mut high = edge.0;
            high[edge.1] += 1;
            Some((edge, [*nearest.get(&edge.0)?, *nearest.get(&high)?]))
        };
        let edges: Vec<_> =
            edges.into_iter().filter(|&edge| !is_tissue(lattice, edge)).filter_map(ends).collect();
        let mut of_bricks: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (n, (_, tissue)) in (0..).zip(&edges) {
            of_bricks.entry(tissue.map(|slot| slot / BRICK_SLOTS as u32)).or_default().push(n);
        }
        Self { edges, of_bricks, reach }
    }

    /// How many edges away from the tissue they are at most.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The edges, ascending, and the slots of the nodes that carry their ends.
    pub fn edges(&self) -> &[(GridEdge, [u32; 2])] {
        &self.edges
    }

    /// Of those the ones that hang on a node of a brick that is near, ascending.
    pub fn edges_near(&self, is_near: impl Fn(u32) -> bool) -> impl Iterator<Item = &(GridEdge, [u32; 2])> {
        let near = self.of_bricks.iter().filter(|(bricks, _)| bricks.iter().any(|&brick| is_near(brick)));
        let mut numbers: Vec<u32> = near.flat_map(|(_, numbers)| numbers).copied().collect();
        numbers.sort_unstable();
        numbers.into_iter().map(|n| &self.edges[n as usize])
    }
}
