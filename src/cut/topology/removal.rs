//! Tissue that is gone.
//!
//! What was removed is kept as a set of nodes of the lattice: a piece, or a whole cell, is gone with its corners. Cuts have parted these from all others before, so that the corners of a piece go together, and
//! no piece that is left hangs on a node that is gone. Pieces that are gone keep their places among those of their cell, and walls theirs: what they hang on is not given to others.

use std::collections::{BTreeSet, HashSet};

use super::{Change, HungPiece, LatticeEdge, Topology, cells_around};
use crate::cut::cell::Piece;
use crate::cut::surface::grid::has_edge;
use crate::model::lattice::Lattice;

impl Topology {
    /// Whether a piece was not removed.
    pub fn is_left(&self, hung: &HungPiece) -> bool {
        !self.removed.contains(&hung.nodes[hung.piece.corners.trailing_zeros() as usize])
    }

    /// Whether the cell at a slot is there and in one.
    pub fn is_whole(&self, slot: u32) -> bool {
        !self.cells.contains_key(&slot) && !self.removed.contains(&slot)
    }

    /// Whether the tissue of a node of the lattice was removed.
    pub fn is_removed(&self, node: u32) -> bool {
        self.removed.contains(&node)
    }

    /// Nodes of the lattice whose tissue was removed.
    pub fn removed(&self) -> impl ExactSizeIterator<Item = u32> {
        self.removed.iter().copied()
    }

    /// All cuts and removals so far as one change, as [`Self::everything`] tells the cuts.
    pub fn everything_and_removed(&self, lattice: &Lattice) -> Change {
        let removed: BTreeSet<u32> = self.removed().collect();
        let emptied: BTreeSet<u32> = removed.iter().flat_map(|&node| cells_at(lattice, node)).collect();
        Change {
            removed: removed.into_iter().collect(),
            emptied: emptied.into_iter().collect(),
            ..self.everything()
        }
    }

    /// Slots on which nothing hangs any more: nodes of the lattice, and copies that are there.
    pub fn vacant(&self) -> HashSet<u32> {
        let mut vacant = self.removed.clone();
        let pieces = self.cells.values().flat_map(|cell| &cell.pieces);
        vacant.extend(pieces.filter(|hung| !self.is_left(hung)).flat_map(|hung| hung.nodes));
        vacant
    }

    /// Removes the tissue of nodes that cuts have parted from all others, and notes in `change` what is new of that. Gives the pieces that are gone: material, and volume as a share of a cell.
    pub fn remove(
        &mut self,
        lattice: &Lattice,
        nodes: &BTreeSet<u32>,
        change: &mut Change,
    ) -> Vec<(u8, f64)> {
        let cells: BTreeSet<u32> = nodes.iter().flat_map(|&node| cells_at(lattice, node)).collect();
        let mut gone = Vec::new();
        for &cell in &cells {
            let material = lattice.cell_material(lattice.node_of(cell));
            for hung in self.left_of(lattice, cell) {
                let mut there = own_nodes(&hung).map(|node| nodes.contains(&node));
                if there.next() == Some(true) {
                    debug_assert!(there.all(|there| there), "cuts part what is removed");
                    gone.push((material, hung.piece.volume));
                }
            }
        }
        self.version += u64::from(!gone.is_empty());
        self.removed.extend(nodes);
        change.removed = nodes.iter().copied().collect();
        change.emptied = cells.into_iter().collect();
        gone
    }

    /// Leaves what is left of a cell, and what is gone, the volume that it had where a cut divides it further: that bends all walls in the cell.
    pub(super) fn keep_left(&self, cell: u32, corners: [u32; 8], pieces: &mut [Piece]) {
        let Some(before) = self.cells.get(&cell) else { return };
        let is_gone =
            |piece: &Piece| self.removed.contains(&corners[piece.corners.trailing_zeros() as usize]);
        let gone = |pieces: &mut dyn Iterator<Item = &Piece>| -> f64 {
            pieces.filter(|piece| is_gone(piece)).map(|piece| piece.volume).sum()
        };
        let was = gone(&mut before.pieces.iter().map(|hung| &hung.piece));
        let is = gone(&mut pieces.iter());
        if was == 0.0 {
            return;
        }
        for piece in pieces {
            piece.volume *= if is_gone(piece) { was / is } else { (1.0 - was) / (1.0 - is) };
        }
    }

    /// The nodes of the lattice that hang together with one, itself among them; none where it was removed.
    pub fn part_of(&self, lattice: &Lattice, node: u32) -> BTreeSet<u32> {
        self.part_within(lattice, node, f64::INFINITY).unwrap_or_default()
    }

    /// Parts that a cut has left beside what it has divided, of a volume below `least` cells: their nodes.
    pub fn crumbs(&self, lattice: &Lattice, change: &Change, least: f64) -> Vec<BTreeSet<u32>> {
        let mut seen: HashSet<u32> = HashSet::new();
        let mut crumbs = Vec::new();
        for hung in change.cells.iter().flat_map(|&cell| self.left_of(lattice, cell)) {
            let first = own_nodes(&hung).next().expect("a piece has a corner");
            if !seen.contains(&first)
                && let Some(part) = self.part_within(lattice, first, least)
            {
                seen.extend(&part);
                crumbs.push(part);
            }
        }
        crumbs
    }

    /// The nodes of the lattice that hang together with one; `None` where it was removed, or the part has `most` cells of tissue or more. Looks no further than that much.
    fn part_within(&self, lattice: &Lattice, node: u32, most: f64) -> Option<BTreeSet<u32>> {
        if self.is_removed(node) {
            return None;
        }
        let mut part = BTreeSet::from([node]);
        let mut open = vec![node];
        let mut volume = 0.0;
        while let Some(node) = open.pop() {
            for cell in cells_at(lattice, node) {
                for hung in self.left_of(lattice, cell) {
                    // Each piece once, with the lowest of its nodes.
                    if own_nodes(&hung).min() == Some(node) {
                        volume += hung.piece.volume;
                    }
                }
            }
            if volume >= most {
                return None;
            }
            open.extend(self.linked(lattice, node).filter(|&other| part.insert(other)));
        }
        Some(part)
    }

    /// The nodes at the other ends of the uncut edges from one.
    fn linked<'a>(&'a self, lattice: &'a Lattice, node: u32) -> impl Iterator<Item = u32> + 'a {
        neighbours(lattice, node)
            .filter(|(edge, _)| !self.crossings.contains_key(edge))
            .map(|(_, other)| other)
    }
}

/// The edges of the tissue at a node, and the nodes at their other ends.
pub fn neighbours(lattice: &Lattice, node: u32) -> impl Iterator<Item = (LatticeEdge, u32)> + '_ {
    let at = lattice.node_of(node);
    (0..6_usize).filter_map(move |n| {
        let (axis, is_upward) = (n / 2, n % 2 == 1);
        let mut there = at;
        there[axis] = if is_upward { at[axis] + 1 } else { at[axis].checked_sub(1)? };
        let other = lattice.slot(there)?;
        let slot = if is_upward { node } else { other };
        has_edge(lattice, slot, axis).then_some((LatticeEdge { slot, axis: axis as u8 }, other))
    })
}

/// The nodes of the lattice at a piece's own corners.
pub fn own_nodes(hung: &HungPiece) -> impl Iterator<Item = u32> {
    let (corners, nodes) = (hung.piece.corners, hung.nodes);
    (0..8).filter(move |corner| corners >> corner & 1 != 0).map(move |corner| nodes[corner])
}

/// The cells around a node, by the slots of their lowest corners.
fn cells_at(lattice: &Lattice, node: u32) -> impl Iterator<Item = u32> + '_ {
    cells_around(lattice, lattice.node_of(node)).map(|(cell, _)| cell)
}
