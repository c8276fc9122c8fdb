//! Which tissue lies in a shape, and where the shape's surface crosses edges: a cut around what is to be removed.
//!
//! As a blade's sweep does, it looks at nodes and edges where they are now, deformed. The nodes in the shape are removed with what is nearer to them than the shape's surface on each edge, so that the hole has
//! the shape's form wherever that is wider than a cell.

use std::collections::BTreeSet;
use std::fmt;

use super::margin::Margin;
use super::surface::grid::{GridEdge, GridNode};
use super::topology::{LatticeEdge, neighbours};
use crate::math::Vec3;
use crate::model::lattice::Lattice;

/// Halvings by which a crossing is found: to the last bit of a share.
const HALVINGS: usize = 52;

/// A shape among the nodes of a lattice.
pub struct Region<'a> {
    /// The lattice.
    pub lattice: &'a Lattice,
    /// Displacements of its nodes by their slots, m, model frame.
    pub displacements: &'a [Vec3],
    /// Signed distance of a point from the shape, model frame, m; negative inside.
    pub distance: &'a dyn Fn(Vec3) -> f64,
}

impl fmt::Debug for Region<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Region").finish_non_exhaustive()
    }
}

impl Region<'_> {
    /// Slots of the nodes in the shape.
    pub fn nodes(&self) -> impl Iterator<Item = u32> {
        self.lattice.slots().filter(|&slot| self.is_inside(self.place(slot)))
    }

    /// The edges between some of those nodes and all others, and where they are to be cut, as shares from their lower nodes: on the shape's surface; next to the other node where that is in the shape too.
    pub fn around(&self, nodes: &BTreeSet<u32>) -> Vec<(LatticeEdge, f64)> {
        let edges =
            nodes.iter().flat_map(|&node| neighbours(self.lattice, node).map(move |edge| (node, edge)));
        let leads_out = edges.filter(|(_, (_, other))| !nodes.contains(other));
        let mut around: Vec<_> = leads_out
            .map(|(node, (edge, other))| {
                let share = self.surface_between(self.place(node), self.place(other)).unwrap_or(1.0);
                (edge, if edge.slot == node { share } else { 1.0 - share })
            })
            .collect();
        around.sort_by_key(|&(edge, _)| edge);
        around
    }

    /// The edges of empty cells around the tissue that the shape's surface crosses, and where. They move as the tissue beside them does.
    pub fn around_beyond(&self, margin: &Margin) -> Vec<(GridEdge, f64)> {
        let place = |node: GridNode, slot: u32| {
            Vec3::from(node.map(f64::from)) * self.lattice.cell_m() + self.displacements[slot as usize]
        };
        let crossed = |&((low, axis), [a, b]): &(GridEdge, [u32; 2])| {
            let mut high = low;
            high[axis] += 1;
            let (from, to) = (place(low, a), place(high, b));
            let at = match [from, to].map(|end| self.is_inside(end)) {
                [true, false] => self.surface_between(from, to)?,
                [false, true] => 1.0 - self.surface_between(to, from)?,
                _ => return None,
            };
            Some(((low, axis), at))
        };
        margin.edges().iter().filter_map(crossed).collect()
    }

    fn place(&self, slot: u32) -> Vec3 {
        self.lattice.rest_position(slot) + self.displacements[slot as usize]
    }

    fn is_inside(&self, place: Vec3) -> bool {
        (self.distance)(place) < 0.0
    }

    /// Where, on the way from a point in the shape to another one, the surface is crossed, as a share of the way; `None` where the other is inside too.
    fn surface_between(&self, inside: Vec3, other: Vec3) -> Option<f64> {
        if self.is_inside(other) {
            return None;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.is_inside(inside + (other - inside) * middle) { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }
}
