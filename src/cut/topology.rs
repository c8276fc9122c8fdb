//! Which cells cuts have divided, and which copies of nodes their pieces hang on.
//!
//! A piece keeps all eight nodes of its cell: those at its own corners, and beyond the cut *copies*, which no other side of the cut shares (the virtual nodes
//! of Molino, Bao and Fedkiw 2004, in the form of Sifakis, Der and Fedkiw 2007, who give every piece a corner of its own). Two pieces on a face between
//! cells share its four nodes where they share a corner on it. So each side of a cut keeps the stiffness and the mass of its volume, which change with
//! the place of the cut without a jump; an undivided cell never hangs on a copy.

mod removal;

pub use self::removal::{neighbours, own_nodes};

use std::collections::{BTreeSet, HashMap, HashSet};

use super::cell::{Crossings, EDGES, Partition, Piece, Wall, divide};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::lattice::{Lattice, flag};

/// Least volume of a piece, as a share of its cell: what is thinner weighs and resists as much, at its neighbour's expense.
const LEAST_VOLUME: f64 = 1e-4;
/// How near to a node, as a share of an edge, a cut may cross it.
const LEAST_DISTANCE: f64 = 1e-3;

/// An edge of the lattice between two neighbouring nodes: the slot of the lower one, and its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LatticeEdge {
    /// Slot of the node with the lower coordinate.
    pub slot: u32,
    /// The axis that the edge runs along.
    pub axis: u8,
}

/// A piece of a cell and the nodes that carry it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HungPiece {
    /// Its shape.
    pub piece: Piece,
    /// Slots of the cell's eight nodes, as this piece sees them; corner c is at offset `(c & 1, c >> 1 & 1, c >> 2 & 1)`.
    pub nodes: [u32; 8],
}

/// A whole cell as one piece.
pub fn whole(corners: [u32; 8]) -> HungPiece {
    HungPiece { piece: Piece { corners: 0xff, volume: 1.0, centroid: Vec3::repeat(0.5) }, nodes: corners }
}

/// A cell that is no longer whole.
#[derive(Clone, Debug, PartialEq)]
pub struct DividedCell {
    /// Its material, 1 to 15.
    pub material: u8,
    /// Its pieces.
    pub pieces: Vec<HungPiece>,
    /// The walls between them.
    pub walls: Vec<Wall>,
}

/// A copy of a node that a cut has made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Birth {
    /// Its slot.
    pub slot: u32,
    /// The slot that its cells hung on before: it starts from there, with the same velocity.
    pub from: u32,
}

/// What a cut has changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// Edges that have been cut, ascending: also where that divides no cell as yet.
    pub edges: Vec<LatticeEdge>,
    /// Cells that were divided, or divided further, by the slots of their lowest corners, ascending.
    pub cells: Vec<u32>,
    /// Cells beside them whose pieces hang on other nodes now, ascending.
    pub rehung: Vec<u32>,
    /// New nodes, ascending.
    pub births: Vec<Birth>,
    /// Nodes of the lattice whose tissue was removed, ascending.
    pub removed: Vec<u32>,
    /// Cells that lost tissue by that, wholly or in part, ascending.
    pub emptied: Vec<u32>,
}

impl Change {
    /// Cells that have other pieces than before: divided, or less of them.
    pub fn reshaped(&self) -> impl Iterator<Item = u32> {
        self.cells.iter().chain(&self.emptied).copied()
    }
}

/// What cuts have made of a lattice so far.
#[derive(Clone, Debug)]
pub struct Topology {
    crossings: HashMap<LatticeEdge, f64>,
    cells: HashMap<u32, DividedCell>,
    /// The node that each copy is one of, by its slot in the lattice.
    copies: Vec<u32>,
    /// Nodes of the lattice whose tissue was removed. A piece is gone with any of its own corners: cuts part what is removed from all else, so that they go together.
    removed: HashSet<u32>,
    first_copy: u32,
    capacity: usize,
    version: u64,
}

/// The cells around a node that are there: slots of their lowest corners, and which of their corners the node is.
fn cells_around(lattice: &Lattice, node: [usize; 3]) -> impl Iterator<Item = (u32, usize)> + '_ {
    (0..8).filter_map(move |corner| {
        let offset = |axis: usize| corner >> axis & 1;
        let cell = [0, 1, 2].map(|axis| node[axis].wrapping_sub(offset(axis)));
        let is_inside = (0..3).all(|axis| cell[axis] < lattice.cells()[axis]);
        (is_inside && lattice.cell_material(cell) != 0).then(|| (lattice.corners(cell)[0], corner))
    })
}

/// The bits of the corners that a cell shares over a face with the one on the other side, in both numberings: `axis`, and whether it is the high face.
fn face_bits(bits: u8, axis: usize, is_high: bool) -> u8 {
    (0..8)
        .filter(|c| (c >> axis & 1 == 1) == is_high && bits >> c & 1 != 0)
        .fold(0, |face, c| face | 1 << (c & !(1 << axis)))
}

impl Topology {
    /// Of a lattice without a cut. Copies take the slots from `first_copy`, `capacity` of them at most.
    pub fn new(first_copy: u32, capacity: usize) -> Self {
        Self {
            crossings: HashMap::new(),
            cells: HashMap::new(),
            copies: Vec::new(),
            removed: HashSet::new(),
            first_copy,
            capacity,
            version: 0,
        }
    }

    /// How often cuts have changed something.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// The divided cell at a slot, if that cell is divided.
    pub fn cell(&self, slot: u32) -> Option<&DividedCell> {
        self.cells.get(&slot)
    }

    /// The divided cells by slot, ascending.
    pub fn cells(&self) -> Vec<(u32, &DividedCell)> {
        let mut cells: Vec<_> = self.cells.iter().map(|(&slot, cell)| (slot, cell)).collect();
        cells.sort_by_key(|(slot, _)| *slot);
        cells
    }

    /// The pieces of divided cells that are left, and their materials, by cells ascending.
    pub fn pieces(&self) -> impl Iterator<Item = (u8, HungPiece)> {
        let left = |cell: &DividedCell| -> Vec<(u8, HungPiece)> {
            cell.pieces.iter().filter(|hung| self.is_left(hung)).map(|&hung| (cell.material, hung)).collect()
        };
        self.cells().into_iter().flat_map(move |(_, cell)| left(cell))
    }

    /// What is left of a cell by the slot of its lowest corner: all of it as one piece where it is not divided.
    pub fn left_of(&self, lattice: &Lattice, cell: u32) -> Vec<HungPiece> {
        let all = match self.cells.get(&cell) {
            Some(divided) => divided.pieces.clone(),
            None => vec![whole(lattice.corners(lattice.node_of(cell)))],
        };
        all.into_iter().filter(|hung| self.is_left(hung)).collect()
    }

    /// What is left of divided cells and hangs on a slot, by cells ascending: materials, and volumes as shares of a cell.
    pub fn hung_on(&self, lattice: &Lattice, slot: u32) -> Vec<(u8, f64)> {
        let mut around: Vec<_> = cells_around(lattice, lattice.node_of(self.origin(slot))).collect();
        around.sort_unstable();
        let of_cell = |(cell, corner): (u32, usize)| {
            let divided = self.cells.get(&cell).into_iter();
            let pieces = divided.flat_map(|cell| cell.pieces.iter().map(|hung| (cell.material, hung)));
            let here = pieces.filter(move |(_, hung)| hung.nodes[corner] == slot && self.is_left(hung));
            here.map(|(material, hung)| (material, hung.piece.volume))
        };
        around.into_iter().flat_map(of_cell).collect()
    }

    /// The slots of all nodes on which something else may hang since a change, ascending.
    pub fn nodes_of(&self, lattice: &Lattice, change: &Change) -> Vec<u32> {
        let of_cell = |cell: u32| {
            let pieces = self.cells.get(&cell).into_iter().flat_map(|cell| &cell.pieces);
            let corners = lattice.corners(lattice.node_of(cell));
            corners.into_iter().chain(pieces.flat_map(|hung| hung.nodes))
        };
        let mut nodes: Vec<u32> =
            change.reshaped().chain(change.rehung.iter().copied()).flat_map(of_cell).collect();
        nodes.extend(change.births.iter().flat_map(|birth| [birth.slot, birth.from]));
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// How many cells are divided.
    pub fn cell_count(&self) -> usize {
        self.cells.len()
    }

    /// How many copies of nodes there are.
    pub fn copy_count(&self) -> usize {
        self.copies.len()
    }

    /// Slots of the copies, ascending.
    pub fn copies(&self) -> impl Iterator<Item = u32> {
        self.first_copy..self.first_copy + self.copies.len() as u32
    }

    /// The node of the lattice that a slot is, or is a copy of.
    pub fn origin(&self, slot: u32) -> u32 {
        if slot < self.first_copy { slot } else { self.copies[(slot - self.first_copy) as usize] }
    }

    /// Whether there is tissue along an edge, not cut and not removed yet, and all of it of materials that are soft.
    pub fn can_cut(&self, lattice: &Lattice, edge: LatticeEdge, is_soft: impl Fn(u8) -> bool) -> bool {
        let mut around = cells_around(lattice, lattice.node_of(edge.slot))
            .filter(|(_, corner)| corner >> edge.axis & 1 == 0)
            .map(|(cell, _)| lattice.cell_material(lattice.node_of(cell)))
            .peekable();
        // What was removed is cut off: an edge that is not cut has both ends there, or none.
        let is_there = !self.crossings.contains_key(&edge) && !self.removed.contains(&edge.slot);
        is_there && around.peek().is_some() && around.all(is_soft)
    }

    /// Flags of a copy, by those of the lattice's own slots: it is held as the node is along the axes along which one of its pieces has a corner of its own
    /// that is held, and by no tool. What was cut off from what is held is free, and what was removed moves no more.
    pub fn flags_of(&self, lattice: &Lattice, copy: u32, flags: &[u8]) -> u8 {
        let node = self.origin(copy);
        let mut held = 0;
        for (cell, corner) in cells_around(lattice, lattice.node_of(node)) {
            let own = lattice.corners(lattice.node_of(cell));
            let pieces = self.cells.get(&cell).into_iter().flat_map(|cell| &cell.pieces);
            for hung in pieces.filter(|hung| hung.nodes[corner] == copy) {
                if !self.is_left(hung) {
                    return flag::FIX_ALL;
                }
                let corners = (0..8).filter(|c| hung.piece.corners >> c & 1 != 0);
                held |= corners.fold(0, |held, c| held | flags[own[c] as usize]);
            }
        }
        // What a region drives goes by its own nodes.
        let is_driven = flags[node as usize] & flag::DRIVEN != 0;
        if is_driven { 0 } else { flags[node as usize] & held & flag::FIX_ALL }
    }

    /// Where an edge is cut, as a share of its length from its lower node.
    pub fn crossing(&self, edge: LatticeEdge) -> Option<f64> {
        self.crossings.get(&edge).copied()
    }

    /// The edges that are cut, and where.
    pub fn crossings(&self) -> impl Iterator<Item = (LatticeEdge, f64)> + '_ {
        self.crossings.iter().map(|(&edge, &at)| (edge, at))
    }

    /// All cuts so far as one change, in which copies start from the lattice's own nodes.
    pub fn everything(&self) -> Change {
        let mut change = Change {
            edges: self.crossings.keys().copied().collect(),
            cells: self.cells.keys().copied().collect(),
            births: self.copies().map(|slot| Birth { slot, from: self.origin(slot) }).collect(),
            ..Change::default()
        };
        change.edges.sort_unstable();
        change.cells.sort_unstable();
        change
    }

    /// Cuts edges, at shares of their lengths from their lower nodes. Those that are cut already stay as they are.
    ///
    /// Fails when there is no room for the copies that this takes, or for as many pieces; nothing is cut then.
    pub fn cut(&mut self, lattice: &Lattice, edges: &[(LatticeEdge, f64)]) -> Result<Change> {
        let new: HashMap<LatticeEdge, f64> = edges
            .iter()
            .filter(|(edge, _)| !self.crossings.contains_key(edge))
            .map(|&(edge, at)| (edge, at.clamp(LEAST_DISTANCE, 1.0 - LEAST_DISTANCE)))
            .collect();
        let divided = self.divide_around(lattice, &new);
        let (hung, copies, births) = self.hang(lattice, &divided)?;
        // What is kept for each piece has room for as many as there may be copies.
        let kept = self.cells.iter().filter(|(slot, _)| !hung.contains_key(slot)).map(|(_, cell)| cell);
        let pieces: usize = kept.chain(hung.values()).map(|cell| cell.pieces.len()).sum();
        if pieces > self.capacity {
            return Err(Error::Limit(format!(
                "the cut leaves {pieces} pieces of cells, and there is room for {}",
                self.capacity
            )));
        }

        let mut change = Change {
            edges: new.keys().copied().collect(),
            cells: divided.keys().copied().collect(),
            births,
            ..Change::default()
        };
        change.edges.sort_unstable();
        change.cells.sort_unstable();
        for (slot, cell) in hung {
            if !divided.contains_key(&slot) && self.cells.get(&slot) != Some(&cell) {
                change.rehung.push(slot);
            }
            self.cells.insert(slot, cell);
        }
        change.rehung.sort_unstable();
        self.crossings.extend(new);
        self.copies.extend(copies);
        self.version += u64::from(!change.cells.is_empty());
        Ok(change)
    }

    /// The cells that edges, once cut, divide otherwise than now.
    fn divide_around(
        &self,
        lattice: &Lattice,
        new: &HashMap<LatticeEdge, f64>,
    ) -> HashMap<u32, (u8, Partition)> {
        let mut touched = BTreeSet::new();
        for edge in new.keys() {
            let node = lattice.node_of(edge.slot);
            let around = cells_around(lattice, node).filter(|(_, corner)| corner >> edge.axis & 1 == 0);
            touched.extend(around.map(|(cell, _)| cell));
        }
        let mut divided = HashMap::new();
        for cell in touched {
            let at = lattice.node_of(cell);
            let corners = lattice.corners(at);
            let crossings: Crossings = EDGES.map(|edge| {
                let edge = LatticeEdge { slot: corners[edge.low], axis: edge.axis as u8 };
                new.get(&edge).or_else(|| self.crossings.get(&edge)).copied()
            });
            if let Some(mut partition) = divide(&crossings) {
                keep_volumes(&mut partition.pieces);
                self.keep_left(cell, corners, &mut partition.pieces);
                divided.insert(cell, (lattice.cell_material(at), partition));
            }
        }
        divided
    }

    /// Hangs the pieces of `divided` and of all divided cells around them on nodes.
    #[allow(clippy::type_complexity)]
    fn hang(
        &self,
        lattice: &Lattice,
        divided: &HashMap<u32, (u8, Partition)>,
    ) -> Result<(HashMap<u32, DividedCell>, Vec<u32>, Vec<Birth>)> {
        // Where the pieces are that may hang on other nodes: those of the divided cells and of cells that share a node with them. Each starts from the
        // nodes that it, or what it was part of, hung on before.
        let nodes: BTreeSet<u32> =
            divided.keys().flat_map(|&cell| lattice.corners(lattice.node_of(cell))).collect();
        let mut hung: HashMap<u32, DividedCell> = HashMap::new();
        for (cell, _) in nodes.iter().flat_map(|&node| cells_around(lattice, lattice.node_of(node))) {
            if hung.contains_key(&cell) {
                continue;
            }
            let before = self.cells.get(&cell);
            if let Some((material, partition)) = divided.get(&cell) {
                let whole = lattice.corners(lattice.node_of(cell));
                let nodes_before = |piece: &Piece| {
                    let of = |old: &&HungPiece| old.piece.corners & piece.corners != 0;
                    before.and_then(|cell| cell.pieces.iter().find(of)).map_or(whole, |old| old.nodes)
                };
                let pieces =
                    partition.pieces.iter().map(|&piece| HungPiece { piece, nodes: nodes_before(&piece) });
                let cell_now = DividedCell {
                    material: *material,
                    pieces: pieces.collect(),
                    walls: partition.walls.clone(),
                };
                hung.insert(cell, cell_now);
            } else if let Some(before) = before {
                hung.insert(cell, before.clone());
            }
        }

        let (mut copies, mut births) = (Vec::new(), Vec::new());
        for &node in &nodes {
            for side in sides(lattice, &hung, node) {
                let slot_in = |&(cell, piece, corner): &Hanger, hung: &HashMap<u32, DividedCell>| {
                    hung[&cell].pieces[piece].nodes[corner]
                };
                let now = if side.is_real {
                    node
                } else {
                    // Sides only ever part, so that all of one hung on the same node before. The first that hung on a copy keeps it.
                    let from = slot_in(&side.hangers[0], &hung);
                    let is_kept = from >= self.first_copy && !side.is_later;
                    if is_kept {
                        from
                    } else {
                        let slot = self.first_copy + (self.copies.len() + copies.len()) as u32;
                        copies.push(node);
                        births.push(Birth { slot, from });
                        slot
                    }
                };
                for &(cell, piece, corner) in &side.hangers {
                    hung.get_mut(&cell).expect("it was listed").pieces[piece].nodes[corner] = now;
                }
            }
        }
        if self.copies.len() + copies.len() > self.capacity {
            return Err(Error::Limit(format!(
                "the cut needs {} copies of nodes, and there is room for {}",
                self.copies.len() + copies.len(),
                self.capacity
            )));
        }
        Ok((hung, copies, births))
    }
}

/// A divided cell, a piece of it, and the corner by which it hangs on a node.
type Hanger = (u32, usize, usize);

/// Pieces around a node that hang on it together.
struct Side {
    hangers: Vec<Hanger>,
    /// Whether the node itself is theirs.
    is_real: bool,
    /// Whether a side before this one hung on the same copy.
    is_later: bool,
}

/// The sides around a node: pieces that share a corner on a face between their cells hang on it together, and those that have the node hang on the node itself.
fn sides(lattice: &Lattice, hung: &HashMap<u32, DividedCell>, node: u32) -> Vec<Side> {
    struct Around {
        hanger: Option<Hanger>,
        corner: usize,
        corners: u8,
    }
    let mut all: Vec<Around> = Vec::with_capacity(16);
    for (cell, corner) in cells_around(lattice, lattice.node_of(node)) {
        match hung.get(&cell) {
            Some(divided) => all.extend(divided.pieces.iter().enumerate().map(|(piece, hung)| Around {
                hanger: Some((cell, piece, corner)),
                corner,
                corners: hung.piece.corners,
            })),
            None => all.push(Around { hanger: None, corner, corners: 0xff }),
        }
    }
    let has_node = |around: &Around| around.corners >> around.corner & 1 != 0;
    let hang_together = |a: &Around, b: &Around| {
        if has_node(a) && has_node(b) {
            return true;
        }
        // Cells are neighbours over a face where the node is at corners of them that differ along one axis; the cell that has it at the higher corner is the lower one.
        let across = a.corner ^ b.corner;
        if across.count_ones() != 1 {
            return false;
        }
        let axis = across.trailing_zeros() as usize;
        let on_face = |around: &Around| face_bits(around.corners, axis, around.corner >> axis & 1 == 1);
        on_face(a) & on_face(b) != 0
    };
    let mut group: Vec<usize> = (0..all.len()).collect();
    for a in 0..all.len() {
        for b in 0..a {
            if group[a] != group[b] && hang_together(&all[a], &all[b]) {
                let (low, high) = (group[a].min(group[b]), group[a].max(group[b]));
                group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
            }
        }
    }
    let mut sides: Vec<Side> = Vec::new();
    let mut kept: Vec<u32> = Vec::new();
    for lowest in 0..all.len() {
        let members = || (0..all.len()).filter(|&n| group[n] == lowest).map(|n| &all[n]);
        let hangers: Vec<Hanger> = members().filter_map(|around| around.hanger).collect();
        if hangers.is_empty() {
            continue;
        }
        let is_real = members().any(has_node);
        let (cell, piece, corner) = hangers[0];
        let before = hung[&cell].pieces[piece].nodes[corner];
        sides.push(Side { is_real, is_later: kept.contains(&before), hangers });
        if !is_real {
            kept.push(before);
        }
    }
    sides
}

/// Gives pieces their least volume, at the expense of the largest.
fn keep_volumes(pieces: &mut [Piece]) {
    let mut lacking = 0.0;
    for piece in &mut *pieces {
        let volume = piece.volume.max(LEAST_VOLUME);
        lacking += volume - piece.volume;
        piece.volume = volume;
    }
    let largest =
        pieces.iter_mut().max_by(|a, b| a.volume.total_cmp(&b.volume)).expect("a divided cell has pieces");
    largest.volume -= lacking;
}

#[cfg(test)]
mod tests;
