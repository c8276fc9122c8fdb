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
mod tests {
    use super::*;
    use crate::cut::sweep::share;
    use crate::noise::Noise;

    const H: f64 = 2e-3;

    fn block(cells: [usize; 3]) -> Lattice {
        Lattice::new(cells, H, &vec![1; cells.iter().product()]).unwrap()
    }

    /// A lattice in which about a sixth of the cells is missing.
    fn ragged() -> Lattice {
        let mut noise = Noise(7);
        let materials: Vec<u8> = (0..420).map(|_| u8::from(noise.next() > -0.7)).collect();
        Lattice::new([10, 7, 6], H, &materials).unwrap()
    }

    fn topology(lattice: &Lattice) -> Topology {
        Topology::new(lattice.slot_count() as u32, 100_000)
    }

    /// The edges of occupied cells that a triangle crosses, in cells.
    fn crossed(lattice: &Lattice, triangle: [Vec3; 3]) -> Vec<(LatticeEdge, f64)> {
        let mut all = BTreeSet::new();
        for (cell, _) in lattice.occupied() {
            let corners = lattice.corners(cell);
            all.extend(EDGES.map(|edge| (corners[edge.low], edge.axis as u8)));
        }
        let at = |slot: u32| Vec3::from(lattice.node_of(slot).map(|i| i as f64));
        all.into_iter()
            .filter_map(|(slot, axis)| {
                let beyond = at(slot) + Vec3::ith(usize::from(axis), 1.0);
                share(at(slot), beyond, triangle).map(|t| (LatticeEdge { slot, axis }, t))
            })
            .collect()
    }

    fn random_triangle(noise: &mut Noise, lattice: &Lattice) -> [Vec3; 3] {
        let size = Vec3::from(lattice.cells().map(|n| n as f64));
        [(); 3].map(|()| Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.8 * noise.next())))
    }

    /// Every piece and every whole cell: its volume, its corners, and the nodes that it hangs on.
    fn everything(lattice: &Lattice, topology: &Topology) -> Vec<(u32, f64, u8, [u32; 8])> {
        let mut all = Vec::new();
        for (cell, _) in lattice.occupied() {
            let corners = lattice.corners(cell);
            match topology.cell(corners[0]) {
                None => all.push((corners[0], 1.0, 0xff, corners)),
                Some(divided) => all.extend(
                    divided
                        .pieces
                        .iter()
                        .map(|hung| (corners[0], hung.piece.volume, hung.piece.corners, hung.nodes)),
                ),
            }
        }
        all
    }

    /// How many parts pieces form that share nodes, and the volume of each in cells.
    fn parts(lattice: &Lattice, topology: &Topology) -> Vec<f64> {
        let all = everything(lattice, topology);
        let mut of_node: HashMap<u32, usize> = HashMap::new();
        let mut part: Vec<usize> = (0..all.len()).collect();
        fn root(part: &mut [usize], mut n: usize) -> usize {
            while part[n] != n {
                part[n] = part[part[n]];
                n = part[n];
            }
            n
        }
        for (n, (.., nodes)) in all.iter().enumerate() {
            for node in nodes {
                let other = *of_node.entry(*node).or_insert(n);
                let (a, b) = (root(&mut part, n), root(&mut part, other));
                part[a.max(b)] = a.min(b);
            }
        }
        let mut volumes = vec![0.0; all.len()];
        for n in 0..all.len() {
            let at = root(&mut part, n);
            volumes[at] += all[n].1;
        }
        volumes.retain(|&volume| volume > 0.0);
        volumes
    }

    /// What holds after any cuts.
    fn check(lattice: &Lattice, topology: &Topology) {
        let all = everything(lattice, topology);
        let total: f64 = all.iter().map(|(_, volume, ..)| volume).sum();
        assert!((total - lattice.cell_count() as f64).abs() < 1e-9 * total);
        let mut used = BTreeSet::new();
        for (cell, volume, corners, nodes) in &all {
            assert!(*volume >= 0.99 * LEAST_VOLUME && *volume <= 1.0, "{volume}");
            let own = lattice.corners(lattice.node_of(*cell));
            for corner in 0..8 {
                // A piece hangs on the node itself at its own corners, and everywhere on that node or a copy of it.
                assert!(corners >> corner & 1 == 0 || nodes[corner] == own[corner]);
                assert_eq!(topology.origin(nodes[corner]), own[corner]);
                used.insert(nodes[corner]);
            }
        }
        // No copy dangles, and no node of the lattice is lost.
        assert_eq!(used.len(), lattice.node_count() + topology.copy_count());
    }

    #[test]
    fn a_plane_parts_a_block_in_two_that_share_no_node_and_have_their_exact_volumes() {
        let lattice = block([9, 5, 4]);
        for height in [2.3, 2.0 + 1e-9, 2.5, 2.999] {
            let mut topology = topology(&lattice);
            // Larger than the block, in two triangles.
            let [a, b, c, d] =
                [[-1.0, -1.0], [11.0, -1.0], [11.0, 6.0], [-1.0, 6.0]].map(|[x, y]| Vec3::new(x, y, height));
            let mut edges = crossed(&lattice, [a, b, c]);
            edges.extend(crossed(&lattice, [a, c, d]));
            let change = topology.cut(&lattice, &edges).unwrap();
            check(&lattice, &topology);
            assert_eq!(change.cells.len(), 45);
            // Each side has copies of the two layers of nodes beyond the cut.
            assert_eq!((change.births.len(), topology.copy_count()), (120, 120));
            let volumes = parts(&lattice, &topology);
            let lower = 45.0 * height.clamp(2.0 + LEAST_DISTANCE, 3.0 - LEAST_DISTANCE);
            assert_eq!(volumes.len(), 2);
            assert!(
                (volumes[0] - lower).abs() < 1e-9 && (volumes[1] - (180.0 - lower)).abs() < 1e-9,
                "{volumes:?}"
            );
        }
    }

    #[test]
    fn behind_the_tip_of_a_cut_both_sides_hang_on_the_same_nodes() {
        let lattice = block([8, 3, 4]);
        let mut topology = topology(&lattice);
        // A blade from the side x = 0 to x = 4.6: four cells are divided, and the fifth holds.
        let triangle = [Vec3::new(4.6, -50.0, 1.4), Vec3::new(4.6, 50.0, 1.4), Vec3::new(-99.0, 0.0, 1.4)];
        topology.cut(&lattice, &crossed(&lattice, triangle)).unwrap();
        check(&lattice, &topology);
        assert_eq!(topology.cells().len(), 4 * 3);
        assert_eq!(parts(&lattice, &topology).len(), 1);
        // Copies of two nodes in each column along z, at x = 0 to 3; at x = 4 the whole cell holds them.
        assert_eq!(topology.copy_count(), 4 * 4 * 2);
    }

    #[test]
    fn cuts_in_many_steps_end_where_one_step_does() {
        let mut noise = Noise(21);
        for _ in 0..20 {
            let lattice = ragged();
            let (mut once, mut often) = (topology(&lattice), topology(&lattice));
            let mut edges: HashMap<LatticeEdge, f64> = HashMap::new();
            for _ in 0..4 {
                for (edge, at) in crossed(&lattice, random_triangle(&mut noise, &lattice)) {
                    edges.entry(edge).or_insert(at);
                }
            }
            let mut edges: Vec<_> = edges.into_iter().collect();
            edges.sort_by_key(|(edge, _)| *edge);
            once.cut(&lattice, &edges).unwrap();
            // In any order: a blade may go to and fro.
            let stride = 1 + (noise.next().abs() * 7.0) as usize;
            for start in 0..stride {
                let some: Vec<_> = edges.iter().skip(start).step_by(stride).copied().collect();
                for few in some.chunks(5) {
                    let change = often.cut(&lattice, few).unwrap();
                    // A copy is born from what its cells hung on.
                    assert!(
                        change
                            .births
                            .iter()
                            .all(|birth| often.origin(birth.from) == often.origin(birth.slot))
                    );
                }
                check(&lattice, &often);
            }
            check(&lattice, &once);
            let (a, b) = (everything(&lattice, &once), everything(&lattice, &often));
            assert_eq!(a.len(), b.len());
            // The same pieces, on the same nodes but for the names of copies.
            let mut names: HashMap<u32, u32> = HashMap::new();
            for (a, b) in a.iter().zip(&b) {
                assert_eq!((a.0, a.1, a.2), (b.0, b.1, b.2));
                for (a, b) in a.3.iter().zip(b.3) {
                    assert_eq!(*names.entry(*a).or_insert(b), b);
                }
            }
            assert_eq!(names.values().collect::<BTreeSet<_>>().len(), names.len());
            let (mut a, mut b) = (parts(&lattice, &once), parts(&lattice, &often));
            a.sort_by(f64::total_cmp);
            b.sort_by(f64::total_cmp);
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9) && a.len() == b.len());
        }
    }

    /// So many random cuts of ragged bodies, a new one after every forty.
    fn cut_at_random(count: usize) {
        let (mut noise, lattice) = (Noise(57), ragged());
        let mut topology = topology(&lattice);
        for cut in 0..count {
            if cut % 40 == 0 {
                topology = self::topology(&lattice);
            }
            topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
            check(&lattice, &topology);
        }
    }

    #[test]
    fn a_thousand_random_cuts_lose_nothing_and_leave_no_copy_dangling() {
        cut_at_random(1000);
    }

    #[test]
    #[ignore = "takes minutes; tests/long.sh runs it"]
    fn a_hundred_thousand_random_cuts_lose_nothing_and_leave_no_copy_dangling() {
        cut_at_random(100_000);
    }

    #[test]
    fn random_cuts_lose_nothing_until_every_node_stands_alone() {
        let mut noise = Noise(33);
        let lattice = ragged();
        let mut topology = topology(&lattice);
        for _ in 0..200 {
            topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
            check(&lattice, &topology);
        }
        // Each edge, one after the other: then each node carries what is next to it.
        let all: Vec<_> = lattice
            .slots()
            .flat_map(|slot| [0, 1, 2].map(|axis| (LatticeEdge { slot, axis }, 0.5)))
            .collect();
        topology.cut(&lattice, &all).unwrap();
        check(&lattice, &topology);
        assert!(topology.cells().iter().all(|(_, cell)| cell.pieces.len() == 8));
        assert_eq!(parts(&lattice, &topology).len(), lattice.node_count());
        let version = topology.version();
        assert_eq!(topology.cut(&lattice, &all).unwrap(), Change::default());
        assert_eq!(topology.version(), version);
    }

    #[test]
    fn random_cuts_and_removals_lose_nothing_but_what_is_removed() {
        let (mut noise, lattice) = (Noise(91), ragged());
        let size = Vec3::from(lattice.cells().map(|n| n as f64));
        for _ in 0..20 {
            let mut topology = topology(&lattice);
            let mut gone = 0.0;
            for _ in 0..12 {
                topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
                let middle = Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.5 * noise.next()));
                let is_near = |&slot: &u32| {
                    (Vec3::from(lattice.node_of(slot).map(|i| i as f64)) - middle).norm() < 1.9
                        && !topology.is_removed(slot)
                };
                let nodes: BTreeSet<u32> = lattice.slots().filter(is_near).collect();
                let links = nodes.iter().flat_map(|&node| neighbours(&lattice, node));
                let leaving = links.filter(|(_, other)| !nodes.contains(other));
                let leaving: Vec<_> = leaving.map(|(edge, _)| (edge, 0.3)).collect();
                let mut change = topology.cut(&lattice, &leaving).unwrap();
                let removed = topology.remove(&lattice, &nodes, &mut change);
                gone += removed.iter().map(|(_, volume)| volume).sum::<f64>();
                assert_eq!(change.removed, nodes.into_iter().collect::<Vec<_>>());

                let (vacant, mut left) = (topology.vacant(), 0.0);
                for (cell, _) in lattice.occupied() {
                    for hung in topology.left_of(&lattice, lattice.corners(cell)[0]) {
                        left += hung.piece.volume;
                        assert!(hung.nodes.iter().all(|slot| !vacant.contains(slot)));
                    }
                }
                assert!((left + gone - lattice.cell_count() as f64).abs() < 1e-9, "{left} and {gone}");
            }
            assert!(gone > 50.0);
        }
    }

    #[test]
    fn a_cut_without_room_for_its_copies_is_refused_whole() {
        let lattice = block([4, 4, 4]);
        let mut topology = Topology::new(lattice.slot_count() as u32, 49);
        let plane = [Vec3::new(-50.0, -50.0, 1.5), Vec3::new(50.0, -50.0, 1.5), Vec3::new(0.0, 99.0, 1.5)];
        let edges = crossed(&lattice, plane);
        let before = format!("{:?}", topology.cells());
        let error = topology.cut(&lattice, &edges).unwrap_err();
        assert!(matches!(&error, Error::Limit(why) if why.contains("needs 50 copies")), "{error}");
        assert_eq!(
            (format!("{:?}", topology.cells()), topology.version(), topology.copy_count()),
            (before, 0, 0)
        );
        assert!(topology.crossing(edges[0].0).is_none());
    }
}
