//! The empty cells around the tissue, into which surfaces bulge.

use std::collections::{BTreeMap, BTreeSet};

use super::surface::grid::{GridEdge, GridNode, edges_at, is_outer, is_tissue, node_of};
use crate::model::lattice::Lattice;

/// The edges of the grid beside the tissue, and the tissue nodes that their ends move with.
#[derive(Clone, Debug)]
pub struct Margin {
    edges: Vec<(GridEdge, [u32; 2])>,
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
        let edges = edges.into_iter().filter(|&edge| !is_tissue(lattice, edge)).filter_map(ends).collect();
        Self { edges, reach }
    }

    /// How many edges away from the tissue they are at most.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The edges, ascending, and the slots of the nodes that carry their ends.
    pub fn edges(&self) -> &[(GridEdge, [u32; 2])] {
        &self.edges
    }
}
