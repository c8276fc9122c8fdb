//! The empty cells around the tissue, into which surfaces bulge.

use std::collections::{BTreeMap, BTreeSet};

use super::extents::Extents;
use super::surface::grid::{GridEdge, GridNode, edges_at, higher_end, is_outer, is_tissue, node_of};
use crate::math::{Bounds, Vec3};
use crate::model::lattice::{BRICK_SLOTS, Lattice};

/// The edges of the grid beside the tissue, and the tissue nodes that their ends move with.
#[derive(Clone, Debug)]
pub struct Margin {
    edges: Vec<(GridEdge, [u32; 2])>,
    groups: Vec<Group>,
}

/// The edges whose lower ends move with nodes of one brick, and their higher ends with nodes of another one, or the same.
#[derive(Clone, Debug)]
struct Group {
    bricks: [u32; 2],
    /// Around the lower and the higher ends at rest, m, model frame.
    ends: [Bounds; 2],
    /// Their numbers, ascending.
    edges: Vec<u32>,
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
        let ends = |edge: GridEdge| Some((edge, [*nearest.get(&edge.0)?, *nearest.get(&higher_end(edge))?]));
        let edges: Vec<_> =
            edges.into_iter().filter(|&edge| !is_tissue(lattice, edge)).filter_map(ends).collect();
        let mut of_bricks: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (n, (_, tissue)) in (0..).zip(&edges) {
            of_bricks.entry(tissue.map(|slot| slot / BRICK_SLOTS as u32)).or_default().push(n);
        }
        let place = |node: GridNode| Vec3::from(node.map(f64::from)) * lattice.cell_m();
        let group = |(bricks, numbers): ([u32; 2], Vec<u32>)| {
            let mut ends = [Bounds::EMPTY; 2];
            for &n in &numbers {
                let (edge, _) = edges[n as usize];
                ends[0].add(place(edge.0));
                ends[1].add(place(higher_end(edge)));
            }
            Group { bricks, ends, edges: numbers }
        };
        let groups = of_bricks.into_iter().map(group).collect();
        Self { edges, groups }
    }

    /// The edges, ascending, and the slots of the nodes that carry their ends.
    pub fn edges(&self) -> &[(GridEdge, [u32; 2])] {
        &self.edges
    }

    /// The groups of edges of which one may meet one of some boxes; none where nothing was looked at.
    pub fn near(&self, extents: &Extents, boxes: &[Bounds]) -> Vec<u32> {
        if extents.is_empty() {
            return Vec::new();
        }
        let all = boxes.iter().fold(Bounds::EMPTY, |all, one| all.union(one));
        let is_near = |&group: &u32| {
            let around = self.bounds(extents, group);
            around.meets(&all, 0.0) && boxes.iter().any(|one| around.meets(one, 0.0))
        };
        (0..self.groups.len() as u32).filter(is_near).collect()
    }

    /// A box around the edges of a group.
    pub fn bounds(&self, extents: &Extents, group: u32) -> Bounds {
        let Group { bricks, ends, .. } = &self.groups[group as usize];
        let [low, high] = [0, 1].map(|end| ends[end].moved(extents.moved(bricks[end])));
        low.union(&high)
    }

    /// The edges of a group.
    pub fn edges_of(&self, group: u32) -> impl Iterator<Item = &(GridEdge, [u32; 2])> {
        self.groups[group as usize].edges.iter().map(|&n| &self.edges[n as usize])
    }

    /// The bricks whose nodes carry the edges of some groups.
    pub fn bricks_of<'a>(&'a self, groups: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        groups.iter().flat_map(|&group| self.groups[group as usize].bricks)
    }
}
